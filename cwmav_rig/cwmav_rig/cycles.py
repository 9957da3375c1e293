# SPDX-License-Identifier: Apache-2.0
"""Flapping cycles from the force: where each begins, its frequency, and which of them can be used.

1. The fundamental is found in the power spectrum as the strongest line whose harmonics explain the rest;
   mains lines and mount resonances have no such family.
2. A complex demodulation at that frequency gives a coarse phase.
3. The phase is refined against the mean waveform: harmonics of the cycle are fitted to all data, then in a
   Hann window of one cycle the shift of phase and amplitude that best explains the residual is solved for.
   This uses every harmonic, so a force dominated by inertia or ringing at 2 F serves as well as a clean sine.
4. A cycle lasts from one multiple of 2 pi of the phase to the next.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, find_objects, label
from scipy.signal import oaconvolve, welch

from cwmav_common.errors import InputError
from cwmav_rig.blocks import Block

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LOWEST, HIGHEST = 3.0, 40.0  # Hz, search range; the rig runs at 4-30 Hz
HARMONICS = 6
MAINS_PIECE, LEAST_TURNS = 10.0, 50  # s, turns of a line below which it is not told from other forces
NEAR_HARMONIC = 0.08  # of the flapping frequency
REFINEMENTS = 4
LINES = 8  # harmonics that speak for a fundamental
SIGNIFICANT = 0.02  # share of the strongest line's amplitude that a fundamental must have
LEAST_CYCLES = 8
PIECE = 1 << 16  # samples handled together
NEGLIGIBLE = 0.6  # share of the waveform's deviation below which a difference does not matter
DEVIATION = 0.25  # a cycle whose length differs more from the median was mistaken
ODD = 4.0  # a cycle that differs from the mean waveform by so many times the usual was disturbed


@dataclass(frozen=True)
class Cycles:
    """Successive flapping cycles.

    Attributes
    ----------
    bounds
        (m + 1,) times [s] at which cycles begin and end.
    good
        (m,) cycles without gap, masked sample or lost phase.
    rejected
        Number of cycles left out, by reason.
    """

    bounds: Array
    good: Mask
    rejected: Counter[str]

    @property
    def frequency(self) -> Array:
        """Frequency of every cycle, (m,) [Hz]."""
        return 1.0 / np.diff(self.bounds)

    @property
    def number(self) -> int:
        """How many cycles can be used."""
        return int(self.good.sum())

    @property
    def rejected_fraction(self) -> float:
        """Share of cycles left out."""
        return 1.0 - self.number / len(self.good) if len(self.good) else 1.0


def find_cycles(block: Block, columns: tuple[str, ...] = ("fz", "fx")) -> Cycles:
    """Find the cycles in the force columns of a block.

    Raises
    ------
    InputError
        The block is too short or shows no periodic force.
    """
    good = block.good
    if good.sum() * block.step < LEAST_CYCLES / HIGHEST:
        raise InputError(
            f"force: only {good.sum() * block.step:.3g} s of usable samples; no cycles can be found"
        )
    signals = np.stack([_filled(block.column(name), good) for name in columns], axis=1)
    frequency = fundamental(signals, 1.0 / block.step)
    signal = signals[:, int(np.argmax(signals.std(axis=0)))]
    signal = without_mains(signal, block.step, frequency)
    phase, residual = refined_phase(signal, block.step, frequency, good)
    phase = _bridged(phase, _widened(~good, round(0.5 / (frequency * block.step))), block.step, frequency)
    return _cut(block, phase, residual, frequency, float(signal.std()))


def fundamental(signals: Array, rate: float) -> float:
    """Find the flapping frequency [Hz] of signals (n, k) sampled at `rate`.

    Raises
    ------
    InputError
        No line in the range stands out.
    """
    length = min(len(signals), int(8.0 * rate))
    freqs, density = welch(signals, rate, nperseg=length, axis=0, detrend="constant")
    amplitude = np.sqrt(density.sum(axis=1) * freqs[1])
    usual = float(np.median(amplitude[(freqs > LOWEST / 2) & (freqs < min(4 * HIGHEST, 0.45 * rate))]))
    floor = max(usual, 1e-3 * float(amplitude.max()))
    candidates = np.arange(LOWEST, min(HIGHEST, 0.2 * rate), freqs[1] / 2.0)
    lines = _lines(freqs, amplitude, candidates)
    families = _families(freqs, amplitude / max(floor, 1e-300), candidates)
    if not len(lines) or not lines.max() > 6.0 * floor > 0.0:
        raise InputError(
            f"force: no periodic signal between {LOWEST:g} and {HIGHEST:g} Hz stands out of the noise"
        )
    able = (lines > SIGNIFICANT * lines.max()) & (lines > 4.0 * floor) & (families > 0.9 * families.max())
    best = candidates[able][np.argmax(lines[able])] if able.any() else candidates[int(np.argmax(families))]
    return _centroid(freqs, amplitude, float(best))


def _lines(freqs: Array, amplitude: Array, wanted: Array) -> Array:
    """Largest amplitude within 2 % or one bin of each wanted frequency (m,), (m,); 0 beyond the spectrum."""
    width = np.maximum(0.02 * wanted, freqs[1]) * (1.0 + 1e-9)
    low, high = np.searchsorted(freqs, wanted - width), np.searchsorted(freqs, wanted + width, side="right")
    padded = np.append(amplitude, 0.0)
    found = np.maximum.reduceat(padded, np.stack([low, high], axis=1).ravel())[::2] if len(wanted) else wanted
    return np.where(low < high, found, 0.0)


def _families(freqs: Array, above_floor: Array, wanted: Array) -> Array:
    """Weigh the lines on the harmonics less those half-way between, which a multiple of the true one has.

    The logarithm makes many lines count for more than a single strong one, which a resonance lifts.
    """
    weight = np.zeros(len(wanted))
    for order in range(1, LINES + 1):
        weight += np.log1p(_lines(freqs, above_floor, order * wanted))
        weight -= np.log1p(_lines(freqs, above_floor, (order - 0.5) * wanted))
    return weight


def _centroid(freqs: Array, amplitude: Array, frequency: float) -> float:
    near = np.abs(freqs - frequency) <= max(0.08 * frequency, 2.0 * freqs[1])
    weight = amplitude[near] ** 2
    return float((freqs[near] * weight).sum() / weight.sum())


def without_mains(signal: Array, step: float, frequency: float) -> Array:
    """Take lines of the mains off a signal (n,), but none that a harmonic of the flapping comes near to.

    The line is fitted in pieces of ten seconds, so that it may drift; flapping wanders too much to be caught.
    """
    left = signal - signal.mean()
    piece = round(MAINS_PIECE / step)
    for line in mains_lines(step, frequency):
        for begin in range(0, len(left), piece):
            part = slice(begin, begin + piece)
            turn = 2.0 * np.pi * line * step * np.arange(begin, begin + len(left[part]))
            if line * step * len(turn) >= LEAST_TURNS:
                basis = np.stack([np.cos(turn), np.sin(turn)], axis=1)
                left[part] -= basis @ (2.0 / len(turn) * (basis.T @ left[part]))
    return np.asarray(left + signal.mean(), np.float64)


def mains_lines(step: float, frequency: float) -> list[float]:
    """Give the mains lines [Hz] that can be told from the harmonics of the flapping frequency."""
    lines = [order * mains for mains in (50.0, 60.0) for order in (1, 3) if order * mains * step < 0.5]
    return [line for line in lines if abs(line / frequency - round(line / frequency)) > NEAR_HARMONIC]


def refined_phase(signal: Array, step: float, frequency: float, good: Mask) -> tuple[Array, Array]:
    """Phase [rad] at every sample of `signal` (n,), and what the mean waveform leaves over (n,)."""
    phase = _demodulated(signal, step, frequency)
    width = max(5, round(1.0 / (frequency * step)) | 1)
    window = np.hanning(width + 2)[1:-1]
    for _ in range(REFINEMENTS):
        model, slope = _waveform(signal, phase, good, step, frequency)
        residual = np.where(good, signal - model, 0.0)
        shape, slope = np.where(good, model - model.mean(), 0.0), np.where(good, slope, 0.0)
        pp, ss = _smooth(slope * slope, window), _smooth(shape * shape, window)
        ps = _smooth(slope * shape, window)
        pr, sr = _smooth(slope * residual, window), _smooth(shape * residual, window)
        determinant = np.maximum(pp * ss - ps * ps, 1e-3 * pp.mean() * ss.mean() + 1e-300)
        phase = phase + np.clip((pr * ss - sr * ps) / determinant, -0.5, 0.5)
    model, _ = _waveform(signal, phase, good, step, frequency)
    return phase, np.where(good, signal - model, 0.0)


def _demodulated(signal: Array, step: float, frequency: float) -> Array:
    n = len(signal)
    turn = 2.0 * np.pi * frequency * step * np.arange(n)
    # Two cycles of Hann: its zeros fall on the mean and on every other harmonic.
    window = np.hanning(max(5, round(2.0 / (frequency * step)) | 1))
    carrier = oaconvolve((signal - signal.mean()) * np.exp(-1j * turn), window, mode="same")
    return np.asarray(turn + np.unwrap(np.angle(carrier)), np.float64)


def _waveform(signal: Array, phase: Array, good: Mask, step: float, frequency: float) -> tuple[Array, Array]:
    """Fit harmonics of the phase to the signal; give the fit and its derivative with the phase.

    In pieces, so that an hour of signal does not need a basis of the same length.
    """
    highest = max(1, min(HARMONICS, int(0.4 / (step * frequency))))
    weights = 1e-9 * len(phase) * np.eye(2 * highest + 1)
    moments = np.zeros(2 * highest + 1)
    pieces = [slice(begin, begin + PIECE) for begin in range(0, len(phase), PIECE)]
    for part in pieces:
        basis = _harmonics(phase[part][good[part]], highest)
        weights += basis.T @ basis
        moments += basis.T @ signal[part][good[part]]
    coefficients = np.linalg.solve(weights, moments)
    slopes = np.zeros_like(coefficients)
    for h in range(1, highest + 1):
        slopes[2 * h - 1], slopes[2 * h] = h * coefficients[2 * h], -h * coefficients[2 * h - 1]
    fit, derivative = np.empty_like(phase), np.empty_like(phase)
    for part in pieces:
        basis = _harmonics(phase[part], highest)
        fit[part], derivative[part] = basis @ coefficients, basis @ slopes
    return fit, derivative


def _harmonics(phase: Array, highest: int) -> Array:
    columns = [np.ones_like(phase)]
    columns += [g(h * phase) for h in range(1, highest + 1) for g in (np.cos, np.sin)]
    return np.stack(columns, axis=1)


def _smooth(values: Array, window: Array) -> Array:
    return np.asarray(oaconvolve(values, window, mode="same"))


def _filled(values: Array, good: Mask) -> Array:
    """Replace masked values by the mean, so that they carry no periodic force."""
    return np.where(good, values, values[good].mean())


def _cut(block: Block, phase: Array, residual: Array, frequency: float, strength: float) -> Cycles:
    time = block.time
    margin = 1.0 / frequency  # the windows of phase and waveform are one-sided at the ends
    inside = (time >= time[0] + margin) & (time <= time[-1] - margin)
    rising = np.maximum.accumulate(phase[inside])
    turns = np.arange(np.ceil(rising[0] / (2 * np.pi)), np.floor(rising[-1] / (2 * np.pi)) + 1)
    if len(turns) < LEAST_CYCLES + 1:
        raise InputError(
            f"force: {max(len(turns) - 1, 0)} whole cycles at {frequency:.3g} Hz; need {LEAST_CYCLES}"
        )
    bounds = np.interp(2 * np.pi * turns, rising, time[inside])
    lengths = np.diff(bounds)
    usual = np.median(lengths)
    wrong = np.abs(lengths / usual - 1.0) > DEVIATION
    masked = _touches(_widened(~block.good, round(0.5 / (frequency * block.step))), block, bounds)
    squares = _interval_means(residual**2, block, bounds)
    usual = ODD**2 * np.median(squares[~masked]) if (~masked).any() else np.inf
    odd = squares > max(usual, NEGLIGIBLE**2 * strength**2)
    reasons = {"gap_or_masked": masked, "odd_waveform": odd & ~masked, "phase_lost": wrong & ~masked & ~odd}
    rejected = Counter({name: int(found.sum()) for name, found in reasons.items()})
    return Cycles(bounds, ~(wrong | masked | odd), +rejected)


def _widened(bad: Mask, half_cycle: int) -> Mask:
    """Widen gaps of more than a quarter cycle by half a cycle: the phase beside them has one side only."""
    if not bad.any():
        return bad
    runs, count = label(bad)
    lengths = np.bincount(runs, minlength=count + 1)
    long = (lengths > half_cycle // 2)[runs] & bad
    return np.asarray(bad | (binary_dilation(long, iterations=max(half_cycle, 1)) if long.any() else bad))


def _bridged(phase: Array, bad: Mask, step: float, frequency: float) -> Array:
    """Draw the phase straight through gaps, with the number of turns that the frequency asks for."""
    runs, count = label(bad)
    phase = phase.copy()
    for run in find_objects(runs) if count else ():
        begin, end = run[0].start - 1, run[0].stop
        if begin < 0 or end >= len(phase):
            continue
        turned = (phase[end] - phase[begin]) / (2.0 * np.pi)
        slip = round(frequency * step * (end - begin) - turned)
        phase[end:] += 2.0 * np.pi * slip
        phase[begin : end + 1] = np.linspace(phase[begin], phase[end], end - begin + 1)
    return phase


def _touches(bad: Mask, block: Block, bounds: Array) -> Mask:
    """Say which intervals between bounds hold a bad sample."""
    count = np.concatenate(([0], np.cumsum(bad)))
    index = np.clip(np.floor((bounds - block.start) / block.step + 0.5).astype(np.int64), 0, len(bad))
    return np.asarray(count[np.minimum(index[1:] + 1, len(bad))] > count[index[:-1]])


def cycle_means(block: Block, column: str, bounds: Array) -> Array:
    """Means of a column over the intervals between `bounds` (m + 1,), (m,); NaN where a sample is missing."""
    values = block.column(column)
    good = np.isfinite(values)
    means = _interval_means(np.where(good, values, 0.0), block, bounds)
    edges = block.start + block.step * (np.array([0, len(values)]) - 0.5)
    outside = (bounds[:-1] < edges[0]) | (bounds[1:] > edges[-1])
    return np.where(outside | _touches(~good, block, bounds), np.nan, means)


def _interval_means(values: Array, block: Block, bounds: Array) -> Array:
    """Means of values (n,) on the grid of `block` over the intervals between `bounds` (m + 1,), (m,)."""
    integral = np.concatenate(([0.0], np.cumsum(values))) * block.step
    edges = block.start + block.step * (np.arange(len(values) + 1) - 0.5)
    return np.asarray(np.diff(np.interp(bounds, edges, integral)) / np.diff(bounds))
