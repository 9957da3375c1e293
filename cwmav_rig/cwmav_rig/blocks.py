# SPDX-License-Identifier: Apache-2.0
"""Samples as the analysis sees them: uniform blocks with gaps marked, and stamped series.

A :class:`Assembler` takes raw samples of any rate piece by piece and keeps bin means of about 1 kHz. Whole
cycles last 30 ms and more, so means over cycles lose nothing, and an hour of 10 kHz recording fits into
memory.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cwmav_rig.raw_spectrum import Spectrum, SpectrumCollector

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

FULL = 1.0 - 1e-6  # share of the range at which a sample counts as saturated
TIME_JUMP = 0.1  # s by which stamps leave the count of samples: the clock was set
STUCK_SAMPLES = 20  # equal values on all channels for so long are a stuck converter, not noise-free physics


@dataclass(frozen=True)
class Block:
    """Values at a uniform rate.

    Attributes
    ----------
    start
        Time of the first value [s] from the origin of the recording.
    step
        Time between values [s].
    names
        Names of the columns.
    values
        (n, k); a row with NaN is a gap or was masked.
    samples, bad
        Raw samples that should be there, and those missing or masked.
    faults
        Counts of what was found wrong, by name.
    spectrum
        Power spectral density of the raw samples; None with too few.
    """

    start: float
    step: float
    names: tuple[str, ...]
    values: Array
    samples: int = 0
    bad: int = 0
    faults: Counter[str] = field(default_factory=Counter)
    spectrum: Spectrum | None = field(default=None, compare=False, repr=False)

    @property
    def time(self) -> Array:
        """Times of the values, (n,) [s]."""
        return np.asarray(self.start + self.step * np.arange(len(self.values)), np.float64)

    @property
    def good(self) -> NDArray[np.bool_]:
        """Rows without a gap, (n,)."""
        return np.asarray(np.isfinite(self.values).all(axis=1))

    @property
    def bad_fraction(self) -> float:
        """Share of raw samples that are missing or masked."""
        return self.bad / self.samples if self.samples else 0.0

    def column(self, name: str) -> Array:
        """One column, (n,)."""
        return self.values[:, self.names.index(name)]


@dataclass(frozen=True)
class Series:
    """Stamped values: times (n,) [s] in order, values (n,), how many were expected and bad."""

    time: Array
    values: Array
    samples: int = 0
    bad: int = 0
    faults: Counter[str] = field(default_factory=Counter)

    @property
    def bad_fraction(self) -> float:
        """Share of values that are missing or masked."""
        return self.bad / self.samples if self.samples else 0.0


def series(time: Array, values: Array) -> Series:
    """Order a stamped series, drop what is not finite or repeated, count that and missing values."""
    faults: Counter[str] = Counter()
    finite = np.isfinite(values) & np.isfinite(time)
    faults["nan"] = int((~finite).sum())
    time, values = time[finite], values[finite]
    order = np.argsort(time, kind="stable")
    faults["out_of_order"] = int((np.diff(order) < 0).sum())
    time, values = time[order], values[order]
    if len(time) > 1:
        step = float(np.median(np.diff(time)))
        fresh = np.concatenate(([True], np.diff(time) > 0.25 * step))
        faults["duplicate"] = int((~fresh).sum())
        time, values = time[fresh], values[fresh]
        missing = np.rint(np.diff(time) / step).astype(np.int64) - 1 if step > 0 else np.zeros(0, np.int64)
        faults["missing"] = int(missing[missing > 0].sum())
    samples = len(time) + faults["missing"] + faults["nan"]
    return Series(time, values, samples, faults["missing"] + faults["nan"], +faults)


class Assembler:
    """Collect samples of one instrument into a :class:`Block` of bin means.

    Parameters
    ----------
    names
        Columns of the samples as they come in.
    bin_rate
        Wanted rate of the result [Hz]; the bin is the nearest whole number of samples.
    ranges
        (k,) largest magnitude that the instrument can show; samples that reach it are masked. 0 where it is
        not known.
    """

    def __init__(self, names: tuple[str, ...], bin_rate: float = 1000.0, ranges: Array | None = None) -> None:
        self.names = names
        ranges = np.zeros(len(names)) if ranges is None else ranges
        self._limits = np.where(ranges > 0.0, ranges * FULL, np.inf)
        self.bin_rate = bin_rate
        self.rate = 0.0
        self.faults: Counter[str] = Counter()
        self._next = 0  # index of the next expected sample
        self._sequence: int | None = None
        self._stamp = 0.0
        self._bin = 1
        self._bins: list[Array] = []
        self._bin_numbers: list[Indices] = []
        self._held_index: Indices = np.empty(0, np.int64)
        self._held: Array = np.empty((0, len(names)))
        self._anchors: list[tuple[int, float]] = []
        self._bad = 0
        self._spectrum = SpectrumCollector(len(names))

    def add_blocks(
        self, stamps: Array, rate: float, sequences: Indices, overload: Indices, data: Array
    ) -> None:
        """Add g blocks of n samples: stamps (g,) [s] of their first samples, data (g, n, k)."""
        self._set_rate(rate)
        g, n, k = data.shape
        kept: list[int] = []
        indices: list[int] = []
        for j in range(g):
            place = self._place(float(stamps[j]), int(sequences[j]), n)
            if place is None:
                self.faults["duplicate"] += n
                continue
            kept.append(j)
            indices.append(place)
        if not kept:
            return
        values = np.asarray(data[kept], np.float64)
        overloaded = overload[kept] > 0
        bad = np.zeros((len(kept), n), bool)
        if overloaded.any():
            self.faults["overload"] += int(overload[kept].sum())
            # Where the samples at the end of the range account for the flags, the others are good.
            flagged = overloaded & (self._saturated(values).sum(axis=1) < overload[kept])
            bad[flagged] = True
            self.faults["beside_overload"] += int((n - overload[kept])[flagged].sum())
        index = (np.array(indices)[:, None] + np.arange(n)).ravel()
        self._add(index, values.reshape(-1, k), bad.ravel())

    def add_samples(self, stamps: Array, data: Array) -> None:
        """Add single samples: stamps (n,) [s] in order, data (n, k)."""
        if not self.rate:
            steps = np.diff(stamps)
            steps = steps[steps > 0]
            self._set_rate(1.0 / float(np.median(steps)) if len(steps) else 1.0)
        previous = self._stamp if self._anchors else float(stamps[0]) - 1.0 / self.rate
        steps = np.rint(np.diff(stamps, prepend=previous) * self.rate).astype(np.int64)
        fresh = steps > 0
        self.faults["duplicate"] += int((~fresh).sum())
        gaps = steps[fresh] - 1
        index = self._next - 1 + np.cumsum(steps[fresh])
        if not len(index):
            return
        self._count_gap(int(gaps.sum()), int((gaps > 0).sum()))
        every = max(1, len(index) // 50)
        for i, stamp in zip(index[::every].tolist(), stamps[fresh][::every].tolist(), strict=True):
            self._anchors.append((i, stamp))
        self._stamp = float(stamps[fresh][-1])
        self._next = int(index[-1]) + 1
        self._add(index.astype(np.int64), np.asarray(data, np.float64)[fresh])

    def finish(self, *, last: bool = False) -> Block | None:
        """Give the block of all samples so far; None when there were none.

        More may be added afterwards, unless this is the `last` call, which keeps no copy.
        """
        if not len(self._held_index):
            return None
        held_rows, held_numbers = self._reduced(self._held_index, self._held)
        first = int(self._bin_numbers[0][0]) if self._bin_numbers else int(held_numbers[0])
        values = np.full((int(held_numbers[-1]) - first + 1, len(self.names)), np.nan)
        for k, (numbers, rows) in enumerate(zip(self._bin_numbers, self._bins, strict=True)):
            values[numbers - first] = rows
            if last:
                self._bins[k] = rows[:0]
        values[held_numbers - first] = held_rows
        start, step = self._time_base()
        middle = (first * self._bin + 0.5 * (self._bin - 1)) * step
        expected = self._next - self._anchors[0][0]
        return Block(
            start + middle,
            step * self._bin,
            self.names,
            values,
            expected,
            self._bad,
            +self.faults,
            self._spectrum.result(self.rate),
        )

    @property
    def latest(self) -> float:
        """Time stamp up to which samples came in [s]; minus infinity before the first."""
        return self._stamp if self._anchors else -np.inf

    def tail(self, seconds: float) -> Block | None:
        """Give the last `seconds` of complete bins, cheaply; None when there are none."""
        if not self._bins:
            return None
        first = int(self._bin_numbers[-1][-1]) - int(seconds * self.rate / self._bin) + 1
        parts, numbers = [], []
        for rows, number in zip(reversed(self._bins), reversed(self._bin_numbers), strict=True):
            parts.append(rows)
            numbers.append(number)
            if number[0] <= first:
                break
        joined = np.concatenate(numbers[::-1])
        keep = joined >= first
        joined, rows = joined[keep], np.concatenate(parts[::-1])[keep]
        values = np.full((int(joined[-1]) - int(joined[0]) + 1, len(self.names)), np.nan)
        values[joined - joined[0]] = rows
        start, step = self._time_base()
        middle = (int(joined[0]) * self._bin + 0.5 * (self._bin - 1)) * step
        return Block(start + middle, step * self._bin, self.names, values)

    def _set_rate(self, rate: float) -> None:
        if not self.rate:
            self.rate = rate
            self._bin = max(1, round(rate / self.bin_rate))
        elif abs(rate / self.rate - 1.0) > 0.01:
            self.faults["rate_change"] += 1

    def _place(self, stamp: float, sequence: int, n: int) -> int | None:
        """Index of the first sample of a block, by its sequence number or else by its stamp."""
        if not self._anchors:
            self._sequence = sequence
            index = 0
        else:
            by_stamp = self._next + round((stamp - self._stamp) * self.rate)
            by_sequence = sequence - (self._sequence or 0) if self._sequence is not None else -1
            if sequence and by_sequence >= self._next:
                index = by_sequence
                if abs(by_stamp - by_sequence) > max(2.0, TIME_JUMP * self.rate):
                    self.faults["time_jump"] += 1
            elif abs(by_stamp - self._next) <= max(2, n // 4):
                index = self._next
                self._sequence = sequence - index if sequence else None
            elif by_stamp > self._next:
                index = by_stamp  # no sequence numbers, or they started again
                self._sequence = sequence - index if sequence else None
            else:
                return None
        self._count_gap(index - self._next, int(index > self._next))
        self._anchors.append((index, stamp))
        self._next = index + n
        self._stamp = stamp + n / self.rate
        return index

    def _count_gap(self, samples: int, gaps: int) -> None:
        if samples > 0:
            self.faults["lost"] += samples
            self.faults["gaps"] += gaps
            self._bad += samples

    def _saturated(self, data: Array) -> NDArray[np.bool_]:
        return np.asarray((np.abs(data) >= self._limits).any(axis=-1))

    def _add(self, index: Indices, data: Array, flagged: NDArray[np.bool_] | None = None) -> None:
        bad = np.zeros(len(data), bool) if flagged is None else flagged
        for name, found in (
            ("nan", ~np.isfinite(data).all(axis=1)),
            ("saturated", self._saturated(data)),
            ("stuck", _stuck(data)),
        ):
            self.faults[name] += int((found & ~bad).sum())
            bad = bad | found
        self._bad += int(bad.sum())
        if bad.any():
            data = data.copy()
            data[bad] = np.nan
        self._spectrum.add(index, data)
        index = np.concatenate((self._held_index, index))
        data = np.concatenate((self._held, data))
        last = index[-1] // self._bin
        whole = index // self._bin < last
        if whole.any():
            means, numbers = self._reduced(index[whole], data[whole])
            self._bins.append(means)
            self._bin_numbers.append(numbers)
        self._held_index, self._held = index[~whole], data[~whole]

    def _reduced(self, index: Indices, data: Array) -> tuple[Array, Indices]:
        """Means over bins and the numbers of the bins; an incomplete bin is a gap."""
        numbers = index // self._bin
        first = np.concatenate(([0], np.flatnonzero(np.diff(numbers)) + 1))
        counts = np.diff(np.concatenate((first, [len(numbers)])))
        means = np.add.reduceat(data, first, axis=0) / self._bin
        means[counts != self._bin] = np.nan
        return means, numbers[first]

    def _time_base(self) -> tuple[float, float]:
        """Time of sample 0 and sample period [s]: a straight line through the stamps, robust to late ones."""
        anchors = np.array(self._anchors)
        index, stamp = self._longest_steady(anchors[:, 0], anchors[:, 1])
        if len(index) < 3 or index[-1] == index[0]:
            return float(stamp[0] - index[0] / self.rate), 1.0 / self.rate
        keep = np.ones(len(index), bool)
        for _ in range(3):
            slope, start = np.polyfit(index[keep] - index[0], stamp[keep], 1)
            residual = np.abs(stamp - start - slope * (index - index[0]))
            keep = residual <= max(4.0 * float(np.median(residual)), 1e-6)
        if float(np.median(residual)) > 2e-3:
            self.faults["irregular_stamps"] += 1
        return float(start - slope * index[0]), float(slope)

    def _longest_steady(self, index: Array, stamp: Array) -> tuple[Array, Array]:
        """Keep the anchors between two jumps of the clock: a line through both sides of one is none."""
        ahead = stamp - index / self.rate
        jumps = np.flatnonzero(np.abs(np.diff(ahead)) > TIME_JUMP) + 1
        pieces = np.split(np.arange(len(index)), jumps)
        longest = max(pieces, key=len)
        return index[longest], stamp[longest]


def _stuck(data: Array) -> NDArray[np.bool_]:
    """Mark runs of at least STUCK_SAMPLES equal rows."""
    equal = np.concatenate(([False], (np.diff(data, axis=0) == 0.0).all(axis=1)))
    if not equal.any():
        return equal
    edges = np.diff(np.concatenate(([False], equal, [False])).astype(np.int8))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    marked = np.zeros(len(data), bool)
    for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
        if end - begin + 1 >= STUCK_SAMPLES:
            marked[begin - 1 : end] = True
    return marked
