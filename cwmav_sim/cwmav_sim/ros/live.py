# SPDX-License-Identifier: Apache-2.0
"""Work of the node's processes: one live run, watched while it goes; reports are plain values."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cwmav_sim.case import Case
from cwmav_sim.result import LiftResult
from cwmav_sim.run import simulate
from cwmav_sim.solver import Solver
from cwmav_sim.store import ResultStore


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
    """What to show of a run: samples per cycle, pictures per second of wall time, share of the particles."""

    samples_per_cycle: int = 100
    rate: float = 5.0
    particle_share: float = 0.0


@dataclass(frozen=True)
class Sample:
    """Forces on the whole vehicle at one instant [s, cycles, N, N, W, N]."""

    time: float
    phase: float
    lift: float
    drag: float
    power: float
    mean_lift: float


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
    watcher = Watcher(case, view, channel)
    result = simulate(
        case, on_progress=channel.report, cancelled=channel.cancelled, observers=(watcher,), device=device
    )
    result = replace(result, history=None)
    results.put(case, result)
    return result, False


class Watcher:
    """Observes a run and reports samples, wings and particles at their rates."""

    def __init__(self, case: Case, view: View, channel: Channel) -> None:
        self._case, self._view, self._channel = case, view, channel
        self._motion = case.motion()
        self._sample_step = 1.0 / (view.samples_per_cycle * case.flapping_frequency)
        self._next_sample = 0.0
        self._next_view = 0.0
        self._cycle = _CycleMean(case.flapping_frequency)

    def __call__(self, solver: Solver) -> None:
        """Take note of the solver's state after a step."""
        lift, drag, power = (self._case.copies * value for value in totals(solver))
        mean = self._cycle.add(solver.time, lift)
        if solver.time >= self._next_sample:
            self._next_sample += self._sample_step
            phase = solver.time * self._case.flapping_frequency
            self._channel.report(Sample(solver.time, phase, lift, drag, power, mean))
        now = time.monotonic()
        if now >= self._next_view:
            self._next_view = now + 1.0 / self._view.rate
            self._show(solver)

    def _show(self, solver: Solver) -> None:
        nodes = self._motion.state(solver.time).x.astype(np.float32)
        motion = self._motion
        self._channel.report(Surface(nodes, motion.triangles, motion.panel, motion.panel_names))
        if self._view.particle_share > 0:
            step = max(1, round(1.0 / self._view.particle_share))
            self._channel.report(
                Cloud(
                    np.asarray(solver.position[::step], np.float32),
                    np.asarray(solver.velocity[::step], np.float32),
                    np.asarray(solver.pressure[::step], np.float32),
                )
            )


def totals(solver: Solver) -> tuple[float, float, float]:
    """Lift, drag and power of all panels that are simulated, at the solver's last step."""
    info = solver.last
    force = np.sum(info.pressure + info.viscous, axis=0)
    return float(force[2]), float(force[0]), float(np.sum(info.power))


class _CycleMean:
    """Time mean of a signal over the last complete cycle; NaN before the first ends."""

    def __init__(self, frequency: float) -> None:
        self._period = 1.0 / frequency
        self._cycle = 0
        self._integral = 0.0
        self._time = 0.0
        self.mean = math.nan

    def add(self, now: float, value: float) -> float:
        cycle = int(now / self._period + 1e-9)
        if cycle > self._cycle:
            self.mean = self._integral / (self._time - self._cycle * self._period)
            self._cycle, self._integral, self._time = cycle, 0.0, cycle * self._period
        self._integral += value * (now - self._time)
        self._time = now
        return self.mean
