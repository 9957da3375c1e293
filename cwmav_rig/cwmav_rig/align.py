# SPDX-License-Identifier: Apache-2.0
"""Clocks of the instruments against that of the force sensor, from the edges of the synchroniser.

Every instrument stamps the same edges with its own clock. A straight line through the readings gives offset
and skew; what is left over says how well the streams agree.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ClockFit:
    """A clock that shows ``offset + (1 + skew) t`` when the reference shows t [s] from the origin.

    Attributes
    ----------
    residual
        Standard deviation of an edge about the line [s]; zero with fewer than three edges.
    edges
        Edges that both clocks stamped.
    """

    offset: float
    skew: float
    residual: float
    edges: int

    @property
    def offset_std(self) -> float:
        """Standard uncertainty of the offset from the scatter of the edges [s]; the worst over the record."""
        return 2.0 * self.residual / float(np.sqrt(max(self.edges, 1)))

    def to_reference(self, reading: Array) -> Array:
        """Turn readings of this clock into readings of the reference."""
        return (reading - self.offset) / (1.0 + self.skew)


def fit_clock(reference: dict[int, float], other: dict[int, float]) -> ClockFit | None:
    """Compare the stamps [s] of numbered edges; None when no edge is common."""
    common = sorted(set(reference) & set(other))
    if not common:
        return None
    t = np.array([reference[k] for k in common])
    difference = np.array([other[k] for k in common]) - t
    if len(common) == 1:
        return ClockFit(float(difference[0]), 0.0, 0.0, 1)
    keep = np.ones(len(t), bool)
    for _ in range(3):
        skew, offset = np.polyfit(t[keep], difference[keep], 1)
        residual = difference - offset - skew * t
        width = 5.0 * max(float(np.median(np.abs(residual[keep]))), 1e-6)
        keep = np.abs(residual) <= width
        if keep.sum() < 2:
            keep[:] = True
    spread = float(residual[keep].std(ddof=2)) if keep.sum() > 2 else 0.0
    return ClockFit(float(offset), float(skew), spread, int(keep.sum()))


def renumbered(reference: dict[int, float], other: dict[int, float]) -> dict[int, float]:
    """Give edges [s] without numbers those of the nearest reference edges, the mean offset removed.

    So an edge that one instrument missed does not shift the numbers of all later ones. Offsets must be
    shorter than half the time between edges.
    """
    if not reference or not other or reference is other:
        return other
    numbers = np.array(sorted(reference, key=lambda k: reference[k]))
    times = np.array([reference[k] for k in numbers])
    stamps = np.array(sorted(other.values()))
    offset = 0.0
    for _ in range(2):
        nearest = np.abs(stamps[:, None] - offset - times[None]).argmin(axis=1)
        offset = float(np.median(stamps - times[nearest]))
    return {int(numbers[k]): float(stamp) for k, stamp in zip(nearest.tolist(), stamps, strict=True)}
