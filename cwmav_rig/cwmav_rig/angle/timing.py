# SPDX-License-Identifier: Apache-2.0
"""Dropped, repeated and misplaced frames, from stamps and from the camera's frame counter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Stamps = NDArray[np.int64]


@dataclass(frozen=True)
class FrameTiming:
    """How regularly frames came.

    Attributes
    ----------
    frames
        Number of frames seen.
    period
        Median time between frames [s]; NaN with fewer than two.
    dropped
        Frames missing, all gaps together.
    gaps
        ((index of the frame after the gap, frames missing), ...).
    repeated
        Frames with the counter of the one before, or less than half a period after it.
    backwards
        Frames earlier than the one before.
    jitter
        Robust standard deviation of the time between frames without gaps [s].
    """

    frames: int
    period: float
    dropped: int
    gaps: tuple[tuple[int, int], ...]
    repeated: int
    backwards: int
    jitter: float

    @property
    def rate(self) -> float:
        """Frames per second; NaN with fewer than two."""
        return 1.0 / self.period if self.period > 0 else float("nan")


def frame_timing(stamps_ns: Stamps, numbers: Sequence[int | None] = ()) -> FrameTiming:
    """Count what is missing or double.

    Where every frame has a number, numbers decide; otherwise a time step is compared with the median step:
    from 1.5 times on, the nearest whole number of periods less one is missing.

    Parameters
    ----------
    stamps_ns
        (n,) in the order of arrival.
    numbers
        (n,) frame counter, or empty.
    """
    count = len(stamps_ns)
    if count < 2:
        return FrameTiming(count, float("nan"), 0, (), 0, 0, float("nan"))
    steps = np.diff(stamps_ns)
    forward = steps[steps > 0]
    period = float(np.median(forward)) if forward.size else float("nan")
    counted = [number for number in numbers if number is not None]
    missing: NDArray[np.int64]
    if len(counted) == count:
        missing = (np.diff(np.array(counted)) - 1).astype(np.int64)
    elif forward.size:
        missing = np.rint(steps / period).astype(np.int64) - 1
    else:
        missing = np.full(count - 1, -1, dtype=np.int64)
    missing = np.where(steps < 0, 0, missing)
    gaps = tuple((int(i) + 1, int(missing[i])) for i in np.flatnonzero(missing > 0))
    regular = forward[np.abs(forward - period) < 0.5 * period] if forward.size else forward
    spread = float(1.4826 * np.median(np.abs(regular - np.median(regular)))) if regular.size else float("nan")
    return FrameTiming(
        frames=count,
        period=period / 1e9,
        dropped=sum(number for _, number in gaps),
        gaps=gaps,
        repeated=int(((missing < 0) & (steps >= 0)).sum()),
        backwards=int((steps < 0).sum()),
        jitter=spread / 1e9,
    )
