# SPDX-License-Identifier: Apache-2.0
"""Clock of a stream against the force sensor's from the flapping that both see, without any trigger.

The flapping frequency wanders by a percent or so, and every stream that feels the wings shows the same
wandering: this gives an offset without ambiguity. With the phase P(t) of the flapping in the force and the
phase of line h of the stream, S(r) at the reading r of its clock,

    S(r) = h P(t) + lag,    t = (r - offset) / (1 + skew).

1. Frequencies of both on one grid are correlated; the highest peak gives the offset to some ten
   milliseconds.
2. Offset, skew and lag follow by least squares on the phases. The lag (current and force do not peak
   together) is only told from the offset by the wandering, which costs accuracy; where it is known from a
   recording with trigger edges, it is given and only offset and skew are fitted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import correlate, oaconvolve

from cwmav_rig.align import ClockFit
from cwmav_rig.blocks import Block, Series

Array = NDArray[np.float64]

ENOUGH = 250.0  # Hz, of a stream whose lines at F and 2 F are looked for
GRID = 50.0  # Hz, of the correlated frequencies
LARGEST_OFFSET = 2.0  # s
LEAST_CORRELATION = 0.25  # of the frequencies; below it the stream does not show the flapping
CLEAR_PEAK = 1.6  # times the next highest peak of the correlation
APART = 0.4  # s, from a peak of the correlation to another one
LEAST_SPAN = 4.0  # s
CLEAR_LINE = 2.0  # times what a line of noise would be
ROUNDS = 4
CLEAR_CYCLE = 9.0  # rise of chi squared by which the best cycle must beat its neighbours
SMOOTH = np.hanning(17)  # on the grid
UNKNOWN_DELAY = 1e-3  # s: a lag that changes with the frequency, unknown here, looks like an offset


@dataclass(frozen=True)
class PhaseFit:
    """Clock of a stream by its flapping.

    Attributes
    ----------
    clock
        Offset, skew and residual; its `edges` count the flapping cycles used.
    offset_std
        Standard uncertainty of the offset [s].
    lag
        Phase of line `harmonic` of the stream less `harmonic` times the phase of the force [rad], -pi to pi.
    lag_std
        Standard uncertainty of `lag` [rad]; zero when it was given.
    correlation
        Of the frequencies of stream and force.
    """

    clock: ClockFit
    offset_std: float
    lag: float
    lag_std: float
    harmonic: int
    correlation: float


def fit_phase(
    bounds: Array, stream: Block | Series, column: str = "", lag: float | None = None
) -> PhaseFit | None:
    """Fit the clock of a stream.

    Parameters
    ----------
    bounds
        (m + 1,) times [s] at which flapping cycles begin by the force.
    column
        Column of a block.
    lag
        Lag [rad] of the stream where it is known.

    Returns
    -------
    PhaseFit or None
        None when the stream does not show the flapping or is too short.
    """
    sampled = uniform(stream, column)
    if sampled is None or len(bounds) < 16:
        return None
    time, values, good = _thinned(*sampled)
    frequency = (len(bounds) - 1) / (bounds[-1] - bounds[0])
    found = _line_phase(time, values, good, frequency)
    if found is None:
        return None
    phase, usable, harmonic = found
    coarse = _coarse_offset(bounds, time, phase / harmonic, usable)
    if coarse is None:
        return None
    offset, correlation = coarse
    line = _Line(bounds, time[usable], phase[usable], harmonic, frequency, correlation)
    free = _least_squares(line, offset, 0.0, None)
    if free is None or lag is None:
        return free
    return _with_lag(line, free, lag) or free


def lag_of(bounds: Array, stream: Block | Series, column: str = "") -> tuple[float, int] | None:
    """Lag [rad] and harmonic of a stream whose clock already agrees with the force's."""
    sampled = uniform(stream, column)
    if sampled is None or len(bounds) < 16:
        return None
    time, values, good = _thinned(*sampled)
    found = _line_phase(time, values, good, (len(bounds) - 1) / (bounds[-1] - bounds[0]))
    if found is None:
        return None
    phase, usable, harmonic = found
    inside = usable & (time > bounds[0]) & (time < bounds[-1])
    turns = np.interp(time[inside], bounds, np.arange(len(bounds)))
    mean = np.mean(np.exp(1j * (phase[inside] - 2.0 * np.pi * harmonic * turns)))
    return float(np.angle(mean)), harmonic


def uniform(stream: Block | Series, column: str) -> tuple[Array, Array, NDArray[np.bool_]] | None:
    """Lay a stream on a uniform grid: times, values, usable places (n,) each; None when it is too short.

    Gaps are filled with the mean, in a series with a straight line, and marked.
    """
    if isinstance(stream, Block):
        values = stream.column(column)
        time, good = stream.time, np.isfinite(values)
    else:
        if len(stream.time) < 100:
            return None
        step = float(np.median(np.diff(stream.time)))
        time = np.arange(stream.time[0], stream.time[-1], step)
        values = np.interp(time, stream.time, stream.values)
        nearest = np.searchsorted(stream.time, time).clip(1, len(stream.time) - 1)
        good = stream.time[nearest] - stream.time[nearest - 1] < 3.5 * step
    if good.sum() < 100 or time[-1] - time[0] < LEAST_SPAN:
        return None
    return time, np.where(good, values, values[good].mean()), good


def _thinned(time: Array, values: Array, good: NDArray[np.bool_]) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Average neighbours down to a rate that still holds both lines many times, which saves memory."""
    rate = (len(time) - 1) / (time[-1] - time[0])
    every = max(1, int(rate / ENOUGH))
    if every == 1:
        return time, values, good
    n = len(time) // every * every
    parts = (part[:n].reshape(-1, every) for part in (time, values, good))
    times, means, whole = (part.mean(axis=1) for part in parts)
    return times, means, whole == 1.0


def _line_phase(
    time: Array, values: Array, good: NDArray[np.bool_], frequency: float
) -> tuple[Array, NDArray[np.bool_], int] | None:
    """Phase of the stronger of the lines at once and twice the flapping frequency, where it is clear."""
    step = (time[-1] - time[0]) / (len(time) - 1)
    width = round(2.0 / (frequency * step)) | 1
    if width < 9 or len(time) < 4 * width:
        return None
    window = np.hanning(width)
    window /= window.sum()
    centred = np.where(good, values - values[good].mean(), 0.0)
    lines = {}
    for harmonic in (1, 2):
        turn = 2.0 * np.pi * harmonic * frequency * (time - time[0])
        carrier = oaconvolve(centred * np.exp(-1j * turn), window, mode="same")
        lines[harmonic] = (turn, carrier)
    harmonic = max(lines, key=lambda h: float(np.median(np.abs(lines[h][1]))))
    turn, carrier = lines[harmonic]
    # A line of white noise of the same strength would have this amplitude through the window.
    noise = float(centred.std()) * float(np.sqrt((window**2).sum()))
    if float(np.median(np.abs(carrier))) < CLEAR_LINE * noise:
        return None
    usable = np.ones(len(time), bool)
    usable[:width] = usable[-width:] = False
    holes = np.convolve(~good, np.ones(width), mode="same") > 0.25 * width if not good.all() else ~usable
    usable &= ~holes & (np.abs(carrier) > 0.3 * np.median(np.abs(carrier)))
    if usable.sum() * step < LEAST_SPAN / 2.0:
        return None
    return np.asarray(turn + np.unwrap(np.angle(carrier))), usable, harmonic


def _coarse_offset(
    bounds: Array, time: Array, phase: Array, usable: NDArray[np.bool_]
) -> tuple[float, float] | None:
    """Offset [s] at which the wandering of both frequencies agrees best, and the correlation there."""
    begin = max(bounds[0], time[0]) - LARGEST_OFFSET
    end = min(bounds[-1], time[-1]) + LARGEST_OFFSET
    grid = np.arange(begin, end, 1.0 / GRID)
    if len(grid) < GRID * LEAST_SPAN:
        return None
    turns = np.interp(grid, bounds, 2.0 * np.pi * np.arange(len(bounds)), left=np.nan, right=np.nan)
    other = np.interp(grid, time[usable], phase[usable], left=np.nan, right=np.nan)
    a, b = _wandering(turns), _wandering(other)
    products = correlate(b, a, mode="full", method="fft")
    lags = np.arange(-len(a) + 1, len(b)) / GRID
    near = np.abs(lags) <= LARGEST_OFFSET
    norm = float(np.sqrt((a**2).sum() * (b**2).sum()))
    if norm == 0.0:
        return None
    share = products[near] / norm
    best = int(np.argmax(share))
    elsewhere = np.abs(lags[near] - lags[near][best]) > APART
    if share[best] < max(LEAST_CORRELATION, CLEAR_PEAK * float(np.abs(share[elsewhere]).max(initial=0.0))):
        return None
    return float(lags[near][best]), float(share[best])


def _wandering(phase: Array) -> Array:
    """Frequency about its mean, smoothed over about two cycles; zero where the phase is not known."""
    rate = np.gradient(phase)
    known = np.isfinite(rate)
    rate = np.where(known, rate - (rate[known].mean() if known.any() else 0.0), 0.0)
    return np.asarray(np.convolve(rate, SMOOTH / SMOOTH.sum(), mode="same"))


@dataclass(frozen=True)
class _Line:
    """Phase (n,) of a line of a stream at readings (n,) of its clock, and the cycles of the force."""

    bounds: Array
    reading: Array
    phase: Array
    harmonic: int
    frequency: float
    correlation: float

    @property
    def independent(self) -> float:
        """Independent phases: the window joins two cycles."""
        return float(max((self.bounds[-1] - self.bounds[0]) * self.frequency / 2.0, 4.0))


def _with_lag(line: _Line, free: PhaseFit, lag: float) -> PhaseFit | None:
    """Fit with the known lag on the cycle that fits best; None when that cannot be told from the next."""
    period = 1.0 / (line.harmonic * line.frequency)
    start = free.clock.offset + (free.lag - lag) / (2.0 * np.pi) * period
    starts = [start + k * period for k in range(-2, 3)]
    found = [fit for s in starts if (fit := _least_squares(line, s, free.clock.skew, lag)) is not None]
    if not found:
        return None
    found.sort(key=lambda fit: fit.clock.residual)
    best = found[0]
    others = [f for f in found if abs(f.clock.offset - best.clock.offset) > 0.5 * period]
    ratio = (others[0].clock.residual / max(best.clock.residual, 1e-12)) ** 2 if others else np.inf
    return best if (ratio - 1.0) * line.independent > CLEAR_CYCLE else None


def _least_squares(line: _Line, offset: float, skew: float, lag: float | None) -> PhaseFit | None:
    bounds, harmonic, frequency = line.bounds, line.harmonic, line.frequency
    reading, phase = line.reading, line.phase
    every = max(1, len(reading) // (16 * len(bounds)))
    reading, phase = reading[::every], phase[::every]
    turns = 2.0 * np.pi * np.arange(len(bounds))
    middles, rates = 0.5 * (bounds[1:] + bounds[:-1]), 2.0 * np.pi / np.diff(bounds)
    constant = 0.0 if lag is None else lag
    begun = lag is not None
    for _ in range(ROUNDS):
        t = (reading - offset) / (1.0 + skew)
        inside = (t > bounds[0]) & (t < bounds[-1])
        if inside.sum() < 50:
            return None
        t = t[inside]
        gap = phase[inside] - harmonic * np.interp(t, bounds, turns)
        if not begun:
            constant, begun = float(np.median(gap)), True
        gap = gap - constant
        if lag is not None:
            gap = gap - 2.0 * np.pi * np.round(np.median(gap) / (2.0 * np.pi))
        slope = harmonic * np.interp(t, middles, rates)
        columns = [slope, slope * t] if lag is not None else [slope, slope * t, -np.ones(len(t))]
        design = np.stack(columns, axis=1)
        change = -np.linalg.lstsq(design, gap, rcond=None)[0]
        offset, skew = offset + float(change[0]), skew + float(change[1])
        if lag is None:
            constant += float(change[2])
    left = gap + design @ change
    sigma = float(left.std())
    covariance = np.linalg.pinv(design.T @ design) * sigma**2 * max(len(left) / line.independent, 1.0)
    residual = sigma / (2.0 * np.pi * harmonic * frequency)
    shown = float(np.angle(np.exp(1j * constant)))
    lag_std = 0.0 if lag is not None else float(np.sqrt(covariance[2, 2]))
    clock = ClockFit(offset, skew, residual, len(bounds) - 1)
    unknown = UNKNOWN_DELAY if lag is None else 0.0
    return PhaseFit(
        clock, float(np.hypot(np.sqrt(covariance[0, 0]), unknown)), shown, lag_std, harmonic, line.correlation
    )
