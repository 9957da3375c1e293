# SPDX-License-Identifier: Apache-2.0
"""Electrical power over whole flapping cycles.

Current and voltage both pulse with the wings, so the power is the mean of their product; the product of their
means would miss the pulsating part, mean(v i) = mean(v) mean(i) + cov(v, i).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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
