# SPDX-License-Identifier: Apache-2.0
"""Power spectral and probability densities of what was recorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import medfilt, welch
from scipy.stats import gaussian_kde

from cwmav_rig.align_phase import uniform
from cwmav_rig.blocks import Block, Series
from cwmav_rig.distributions import Candidate, candidates

Array = NDArray[np.float64]

SEGMENT = 8.0  # s
BINS = 50
BESIDE = 0.2  # of the flapping frequency: beyond it a multiple does not reach
LOWEST_RESONANCE, HIGHEST_RESONANCE = 30.0, 300.0  # Hz, where a mount may ring
ON_HARMONIC = 0.05  # of the flapping frequency: so near two lines are one, F wanders by as much
STANDS_OUT = 10.0  # times the median density between the lines
LARGEST = 4000  # values behind a kernel density


@dataclass(frozen=True)
class PowerSpectrum:
    """One-sided power spectral density (f,) at `frequency` (f,) [Hz], in squared units per hertz."""

    frequency: Array
    density: Array
    pieces: int


@dataclass(frozen=True)
class ProbabilityDensity:
    """Probability density of one quantity: histogram, kernel estimate, and the distributions fitted to it.

    Attributes
    ----------
    edges, histogram
        (b + 1,) and (b,), of unit area.
    value, kernel
        (v,) places and Gaussian kernel estimate there (Scott's width).
    fitted
        (v,) densities by name of the distribution; all have mean and standard deviation of the record.
    """

    edges: Array
    histogram: Array
    value: Array
    kernel: Array
    fitted: dict[str, Array]


def power_spectrum(stream: Block | Series, column: str = "", factor: float = 1.0) -> PowerSpectrum | None:
    """Welch's estimate (Hann window, half overlap) of a stream; None when it is too short.

    Gaps are bridged by the mean, which takes their share of the power away.
    """
    sampled = uniform(stream, column)
    if sampled is None:
        return None
    time, values, _ = sampled
    rate = float((len(time) - 1) / (time[-1] - time[0]))
    length = int(min(SEGMENT * rate, len(values)))
    frequency, density = welch(factor * values, rate, nperseg=length, detrend="constant")
    return PowerSpectrum(frequency, density, max(1, 2 * len(values) // length - 1))


def mount_resonance(spectra: Sequence[PowerSpectrum], flapping: float) -> float | None:
    """Frequency [Hz] at which the mount rings; None when nothing stands out between the harmonics.

    Parameters
    ----------
    spectra
        Of the force axes; their sum is searched.
    flapping
        Flapping frequency [Hz]; what lies near its multiples or near mains lines is left out.
    """
    if not spectra:
        return None
    frequency = spectra[0].frequency
    density = np.asarray(sum(spectrum.density for spectrum in spectra))
    beside = np.abs(frequency / flapping - np.rint(frequency / flapping)) > BESIDE
    for line in (50.0, 60.0, 100.0, 120.0, 150.0, 180.0):
        beside &= np.abs(frequency - line) > 1.0
    kept = beside & (frequency > LOWEST_RESONANCE) & (frequency < min(HIGHEST_RESONANCE, 0.9 * frequency[-1]))
    if kept.sum() < 50:
        return None
    places, level = frequency[kept], medfilt(density[kept], 9)
    peak = int(np.argmax(level))
    inner = 5 <= peak < len(level) - 5
    return float(places[peak]) if inner and level[peak] > STANDS_OUT * float(np.median(level)) else None


def mains_collision(spectra: Sequence[PowerSpectrum], flapping: float) -> str:
    """Say when the mains lie on a multiple of the flapping frequency [Hz], so that they cannot be told apart.

    Which mains there are shows in their third harmonic; empty without a collision or without that line.
    """
    for mains in (50.0, 60.0):
        multiple = round(mains / flapping)
        if abs(mains / flapping - multiple) < ON_HARMONIC and _shows(spectra, 3.0 * mains):
            return (
                f"{mains:g} Hz of the mains is {multiple} times the flapping frequency of {flapping:.2f} Hz"
            )
    return ""


def _shows(spectra: Sequence[PowerSpectrum], line: float) -> bool:
    for spectrum in spectra:
        beside = np.abs(spectrum.frequency - line)
        near, around = beside < 0.3, (beside > 2.0) & (beside < 15.0)
        if near.any() and around.any():
            usual = float(np.median(spectrum.density[around]))
            if float(spectrum.density[near].max()) > STANDS_OUT * usual > 0.0:
                return True
    return False


def probability_density(values: Array) -> ProbabilityDensity | None:
    """Estimate the probability density of a record (n,), NaN left out; None without scatter."""
    kept = values[np.isfinite(values)]
    if len(kept) < 16 or not kept.std() > 0.0:
        return None
    thinned = kept[:: len(kept) // LARGEST + 1]
    mean, std = float(kept.mean()), float(kept.std())
    value = np.linspace(min(kept.min(), mean - 4.0 * std), max(kept.max(), mean + 4.0 * std), 400)
    histogram, edges = np.histogram(kept, bins=min(BINS, max(8, int(np.sqrt(len(kept))))), density=True)
    z = np.sort((thinned - mean) / std)
    fitted = {c.name: _density(c, (value - mean) / std) / std for c in candidates(z)}
    return ProbabilityDensity(edges, histogram, value, gaussian_kde(thinned)(value), fitted)


def _density(candidate: Candidate, z: Array) -> Array:
    return np.asarray(np.exp(candidate.logpdf(z)))
