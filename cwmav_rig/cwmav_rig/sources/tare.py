# SPDX-License-Identifier: Apache-2.0
"""Wind-off runs: within the recording on a topic of their own, or in recordings of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cwmav_rig.blocks import Block, Series
from cwmav_rig.calibration import TareRun

Array = NDArray[np.float64]

PAUSE = 1.0  # s without samples that separates two runs on one topic
PIECES = 16  # into which a run is cut to see how well its mean is known


@dataclass
class TareCollector:
    """Gathers wind-off samples piece by piece and tells the runs apart by the pauses between them."""

    _stamps: list[float] = field(default_factory=list)
    _means: list[Array] = field(default_factory=list)
    _counts: list[int] = field(default_factory=list)
    _lengths: list[float] = field(default_factory=list)

    def add(self, start: float, length: float, samples: Array) -> None:
        """Take samples (n, 6) that begin at `start` [s] and last `length` [s]; NaN are left out."""
        good = np.asarray(np.isfinite(samples).all(axis=1))
        for part, kept in zip(_parts(samples), _parts(good), strict=True):
            if kept.any():
                self._stamps.append(start)
                self._lengths.append(length)
                self._means.append(part[kept].mean(axis=0))
                self._counts.append(int(kept.sum()))

    def runs(self) -> tuple[TareRun, ...]:
        """Give the runs so far, in order of time."""
        if not self._stamps:
            return ()
        order = np.argsort(self._stamps, kind="stable")
        begin = np.array(self._stamps)[order]
        end = begin + np.array(self._lengths)[order]
        means, counts = np.stack(self._means)[order], np.array(self._counts)[order]
        cuts = np.flatnonzero(begin[1:] - end[:-1] > PAUSE) + 1
        groups = np.split(np.arange(len(begin)), cuts)
        return tuple(
            _run(0.5 * float(begin[g[0]] + end[g].max()), means[g], counts[g]) for g in groups if len(g)
        )


def run_of_block(block: Block, angle: Series | None, shift: float, source: str) -> TareRun:
    """Make the run of a recording of its own, `shift` [s] from the origin of the flapping run."""
    values = block.values[block.good]
    parts = [part for part in _parts(values) if len(part)]
    counts = np.array([len(part) for part in parts])
    run = _run(float(block.time.mean()) + shift, np.stack([p.mean(axis=0) for p in parts]), counts)
    mean_angle = None if angle is None or not len(angle.values) else float(angle.values.mean())
    return TareRun(run.time, run.wrench, mean_angle, run.std, source)


def _parts(values: NDArray) -> Sequence[NDArray]:
    return np.array_split(values, min(PIECES, max(len(values), 1)))


def _run(time: float, means: Array, counts: NDArray[np.int64]) -> TareRun:
    weight = counts / counts.sum()
    wrench = weight @ means
    std = np.zeros(6)
    if len(means) > 1:
        std = np.sqrt(weight**2 @ (means - wrench) ** 2 * len(means) / (len(means) - 1))
    return TareRun(time, wrench, None, std)
