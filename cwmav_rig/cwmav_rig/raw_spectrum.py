# SPDX-License-Identifier: Apache-2.0
"""Power spectral density of raw samples, gathered while they stream by; what lies near its upper end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LENGTH = 2048  # samples of one periodogram
EVERY = 2  # every second piece is used, to save time
LINE = 20.0  # times the usual density at which a line stands out
LINES_FROM = 0.1  # of the sample rate: lines above it are no mechanics of the wings
RISE = 3.0  # times the density below at which energy gathers at the Nyquist frequency


@dataclass(frozen=True)
class Spectrum:
    """One-sided density (f, k) of k columns at frequencies (f,) [Hz], in their units squared per hertz."""

    frequency: Array
    density: Array
    pieces: int


class SpectrumCollector:
    """Averages periodograms (Welch, Hann window, no overlap) of pieces without a gap.

    Pieces begin at multiples of their length, so that the result does not depend on how the samples come in.
    """

    def __init__(self, columns: int) -> None:
        self._sum = np.zeros((LENGTH // 2 + 1, columns))
        self._pieces = 0
        self._window = np.hanning(LENGTH)
        self._index: NDArray[np.int64] = np.empty(0, np.int64)
        self._data: Array = np.empty((0, columns))

    def add(self, index: NDArray[np.int64], data: Array) -> None:
        """Take samples (n, k) with their numbers (n,), in order."""
        index = np.concatenate((self._index, index))
        data = np.concatenate((self._data, data))
        numbers = index // LENGTH
        cuts = np.flatnonzero(np.diff(numbers)) + 1
        begins = np.concatenate(([0], cuts))
        for begin, end in zip(begins[:-1].tolist(), cuts.tolist(), strict=True):
            self._take(int(numbers[begin]), data[begin:end])
        self._index, self._data = index[begins[-1] :], data[begins[-1] :]

    def _take(self, number: int, piece: Array) -> None:
        if number % EVERY or len(piece) < LENGTH or not np.isfinite(piece).all():
            return
        spectrum = np.fft.rfft((piece - piece.mean(axis=0)) * self._window[:, None], axis=0)
        self._sum += np.abs(spectrum) ** 2
        self._pieces += 1

    def result(self, rate: float) -> Spectrum | None:
        """Give the density at the sample rate [Hz]; None before the first whole piece."""
        if not self._pieces:
            return None
        density = self._sum * (2.0 / (rate * float((self._window**2).sum()) * self._pieces))
        return Spectrum(np.asarray(np.fft.rfftfreq(LENGTH, 1.0 / rate), np.float64), density, self._pieces)


def remarks(spectrum: Spectrum, names: tuple[str, ...]) -> list[str]:
    """Say where energy stands that the sampling may have folded there."""
    found = []
    frequency, nyquist = spectrum.frequency, float(spectrum.frequency[-1])
    upper = frequency > LINES_FROM * 2.0 * nyquist
    top, below = frequency > 0.9 * nyquist, (frequency > 0.5 * nyquist) & (frequency < 0.8 * nyquist)
    for name, density in zip(names, spectrum.density.T, strict=True):
        usual = float(np.median(density[upper]))
        if not usual > 0.0:
            continue
        strongest = int(np.argmax(np.where(upper, density, 0.0)))
        if density[strongest] > LINE * usual:
            found.append(
                f"{name}: a line at {frequency[strongest]:.0f} Hz, perhaps folded down by the sampling"
            )
        elif float(np.median(density[top])) > RISE * float(np.median(density[below])):
            found.append(f"{name}: energy gathers below half the sample rate; is there an anti-alias filter?")
    return found
