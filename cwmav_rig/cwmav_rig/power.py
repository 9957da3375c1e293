# SPDX-License-Identifier: Apache-2.0
"""Electrical power over whole flapping cycles.

Current and voltage both pulse with the wings, so the power is the mean of their product; the product of their
means would miss the pulsating part, mean(v i) = mean(v) mean(i) + cov(v, i).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cwmav_rig.align_phase import lag_of
from cwmav_rig.blocks import Block
from cwmav_rig.cycles import cycle_means

Array = NDArray[np.float64]


def cycle_power(block: Block, bounds: Array) -> Array:
    """Mean of v i over every interval between `bounds` (m + 1,), (m,) [W]; NaN where samples are missing."""
    return cycle_means(block, "power", bounds)


def pulsating_share(block: Block) -> float:
    """Part of the power that the product of the mean voltage and mean current misses, relative."""
    good = block.good
    voltage, current, power = (block.column(name)[good].mean() for name in ("voltage", "current", "power"))
    return float(1.0 - voltage * current / power) if power else float("nan")


def channel_delay(block: Block, bounds: Array) -> float | None:
    """Time [s] by which the current lags the voltage, if the supply is a plain resistance; None when unclear.

    Behind a resistance the voltage dips as the current peaks. What their phases at the flapping frequency
    or twice of it differ from half a turn by is then the delay between the two channels.
    """
    voltage, current = lag_of(bounds, block, "voltage"), lag_of(bounds, block, "current")
    if voltage is None or current is None or voltage[1] != current[1]:
        return None
    frequency = (len(bounds) - 1) / (bounds[-1] - bounds[0])
    behind = float(np.angle(np.exp(1j * (voltage[0] + np.pi - current[0]))))
    return float(behind / (2.0 * np.pi * voltage[1] * frequency))


class Deskew:
    """Brings voltage and current of an oscilloscope to the same instant, block by block.

    Parameters
    ----------
    delay
        Time [s] by which the current channel lags the voltage channel; negative when it leads.

    Notes
    -----
    The earlier channel is delayed by linear interpolation, so the product is that of the later channel's
    samples. Where the block before is missing, the first samples are NaN.
    """

    def __init__(self, delay: float) -> None:
        self.delay = delay
        self._tail = np.empty(0)
        self._next: int | None = None

    def apply(
        self, voltage: Array, current: Array, sequences: NDArray[np.int64], rate: float
    ) -> tuple[Array, Array]:
        """Give both channels (g, n) of blocks at `rate` [Hz], aligned; `sequences` (g,) of first samples."""
        if self.delay == 0.0:
            return voltage, current
        early = np.array(voltage if self.delay > 0.0 else current)
        shift = abs(self.delay) * rate
        need = int(np.ceil(shift))
        for row, sequence in zip(early, sequences.tolist(), strict=True):
            joined = len(self._tail) == need and (sequence == self._next or not sequence)
            before = self._tail if joined else np.full(need, np.nan)
            together = np.concatenate((before, row))
            self._tail, self._next = together[len(together) - need :], sequence + len(row)
            place = np.arange(len(row)) + need - shift
            low = np.floor(place).astype(np.int64)
            share = place - low
            high = np.minimum(low + 1, len(together) - 1)
            row[:] = np.where(
                share > 0.0, (1.0 - share) * together[low] + share * together[high], together[low]
            )
        return (early, current) if self.delay > 0.0 else (voltage, early)
