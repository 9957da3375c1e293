# SPDX-License-Identifier: Apache-2.0
"""A signal over the flapping cycle: its mean at every phase, with the band that the cycles fill."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cwmav_rig.blocks import Block, Series
from cwmav_rig.cycles import Cycles

Array = NDArray[np.float64]
BINS = 72


@dataclass(frozen=True)
class PhaseAverage:
    """A signal by the phase of the stroke.

    Attributes
    ----------
    phase
        (n,) middles of the phase bins, in turns from 0 to 1.
    mean, std
        (n,) mean and standard deviation of the samples in each bin; NaN in an empty one.
    low, high
        (n,) 2.5 % and 97.5 % quantiles.
    mean_std
        (n,) standard uncertainty of the mean, from the scatter of the cycles' own means in the bin.
    cycles
        Cycles that entered.
    """

    phase: Array
    mean: Array
    std: Array
    low: Array
    high: Array
    mean_std: Array
    cycles: int


def phase_average(
    stream: Block | Series, cycles: Cycles, column: str = "", bins: int = BINS, values: Array | None = None
) -> PhaseAverage:
    """Average a stream over the good cycles.

    Parameters
    ----------
    column
        Column of a block.
    values
        (n,) values in place of the stream's own, such as a lift made of its columns.
    """
    time = stream.time
    if values is None:
        values = stream.column(column) if isinstance(stream, Block) else stream.values
    owner = np.searchsorted(cycles.bounds, time, side="right") - 1
    inside = (owner >= 0) & (owner < len(cycles.good)) & np.isfinite(values)
    inside[inside] = cycles.good[owner[inside]]
    owner, kept = owner[inside], np.asarray(values)[inside]
    begin, length = cycles.bounds[owner], np.diff(cycles.bounds)[owner]
    place = np.clip(((time[inside] - begin) / length * bins).astype(np.int64), 0, bins - 1)
    order = np.argsort(place, kind="stable")
    groups = np.split(np.arange(len(kept))[order], np.cumsum(np.bincount(place, minlength=bins))[:-1])
    rows = [_row(kept[group], owner[group]) for group in groups]
    mean, std, low, high, mean_std = (np.array(column) for column in zip(*rows, strict=True))
    phase = (np.arange(bins) + 0.5) / bins
    return PhaseAverage(phase, mean, std, low, high, mean_std, len(np.unique(owner)))


def _row(values: Array, owner: NDArray[np.int64]) -> tuple[float, float, float, float, float]:
    nan = float("nan")
    if not len(values):
        return nan, nan, nan, nan, nan
    low, high = np.quantile(values, (0.025, 0.975))
    count = np.bincount(owner)
    has = count > 0
    per_cycle = np.bincount(owner, values)[has] / count[has]
    mean_std = float(per_cycle.std(ddof=1) / np.sqrt(len(per_cycle))) if len(per_cycle) > 1 else nan
    return float(values.mean()), float(values.std()), float(low), float(high), mean_std
