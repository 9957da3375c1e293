# SPDX-License-Identifier: Apache-2.0
"""Work of the node's processes: one live run, watched while it goes; reports are plain values."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cwmav_sim.case import Case
from cwmav_sim.result import LiftResult
from cwmav_sim.run import simulate
from cwmav_sim.store import ResultStore
from cwmav_sim.views import ParticleView


class Channel(Protocol):
    """How the work reports and hears that it should stop."""

    def report(self, value: object) -> None:
        """Hand a value to whoever watches the run."""
        ...

    def cancelled(self) -> bool:
        """Say whether to stop."""
        ...


@dataclass(frozen=True)
class View:
    """What to show of a run: pictures per second of wall time, and the share of the particles in them."""

    rate: float = 5.0
    particle_share: float = 0.0


@dataclass(frozen=True)
class Surface:
    """The wings at one instant: nodes (n, 3) [m], triangles (m, 3), panel (m,) and names of the panels."""

    positions: NDArray[np.float32]
    triangles: NDArray[np.int64]
    panel: NDArray[np.int64]
    panel_names: tuple[str, ...]


@dataclass(frozen=True)
class Cloud:
    """Some of the particles: position, velocity (n, 3) [m, m/s], pressure (n,) [Pa]."""

    position: NDArray[np.float32]
    velocity: NDArray[np.float32]
    pressure: NDArray[np.float32]


def run_live(case: Case, store: Path, device: str, view: View, channel: Channel) -> tuple[LiftResult, bool]:
    """Run a case, or find its result in the store; the second value says that it was found."""
    results = ResultStore(store)
    stored = results.get(case)
    if stored is not None:
        return stored, True
    result = simulate(
        case,
        on_progress=channel.report,
        cancelled=channel.cancelled,
        observers=(Viewer(case, view, channel),),
        device=device,
    )
    result = replace(result, history=None)
    results.put(case, result)
    return result, False


class Viewer:
    """Observes a run and reports wings and particles a few times per second."""

    def __init__(self, case: Case, view: View, channel: Channel) -> None:
        self._view, self._channel = view, channel
        self._motion = case.motion()
        self._next = 0.0

    def __call__(self, solver: ParticleView) -> None:
        """Report the solver's state when it is time."""
        now = time.monotonic()
        if now < self._next:
            return
        self._next = now + 1.0 / self._view.rate
        motion, nodes = self._motion, solver.sheet
        if nodes is not None:
            x = nodes.x.astype(np.float32)
            self._channel.report(Surface(x, motion.triangles, motion.panel, motion.panel_names))
        if self._view.particle_share > 0:
            step = max(1, round(1.0 / self._view.particle_share))
            parts = (solver.position, solver.velocity, solver.pressure)
            self._channel.report(Cloud(*(np.asarray(part[::step], np.float32) for part in parts)))
