# SPDX-License-Identifier: Apache-2.0
"""Run one case: from settings to mean lift."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cwmav_common.errors import CancelledError, InputError, WorkError
from cwmav_common.settings import to_mapping
from cwmav_sim.case import Case
from cwmav_sim.export import write_run
from cwmav_sim.gauges import History, Recorder, cycle_mean, is_periodic, phase_bins
from cwmav_sim.result import LiftResult, Provenance, describe_point
from cwmav_sim.solver import Solver, StepInfo
from cwmav_sim.wing.sheet import FloatArray

logger = logging.getLogger(__name__)

_REPORTS_PER_CYCLE = 50


@dataclass(frozen=True)
class Progress:
    """State of a run in progress.

    Attributes
    ----------
    fraction : float
        Share of the cycles asked for that is done, 0..1.
    cycle, cycles : int
        Current cycle from 1, and how many are planned.
    time : float
        Simulated time [s].
    lift : float
        Lift at this instant [N].
    seconds_left : float
        Estimate of the wall time still needed [s].
    drag, power : float
        Drag at this instant [N] and power given to the air [W].
    mean_lift : float
        Mean lift over the last complete cycle [N]; NaN before the first.
    """

    fraction: float
    cycle: int
    cycles: int
    time: float
    lift: float
    seconds_left: float
    drag: float
    power: float
    mean_lift: float


OnProgress = Callable[[Progress], None]
Observer = Callable[[Solver], None]


def simulate(
    case: Case,
    *,
    on_progress: OnProgress | None = None,
    cancelled: Callable[[], bool] | None = None,
    out: str | Path | None = None,
    observers: Sequence[Observer] = (),
    device: str = "cpu",
) -> LiftResult:
    """Simulate a case and average the forces over whole flapping cycles.

    Parameters
    ----------
    case : Case
        What to run.
    on_progress : callable, optional
        Called with a :class:`Progress` about fifty times per cycle.
    cancelled : callable, optional
        Asked at every step; the run stops when it returns True.
    out : path, optional
        Folder that receives ``result.json``, ``history.csv`` and ``config.yaml``.
    observers : sequence of callables
        Called with the solver after every step, for snapshots and pictures.
    device : {"cpu", "cuda"}
        Where to compute.

    Returns
    -------
    LiftResult
        With its history.

    Raises
    ------
    InputError
        For a device that is not there.
    WorkError
        When the flow blows up; :class:`~cwmav_common.errors.CancelledError` when cancelled.
    """
    check_device(device)
    for line in header(case):
        logger.info(line)
    motion = case.motion()
    solver = Solver(case.flow, motion, case.airspeed, highest_speed=case.highest_speed())
    recorder = Recorder(len(motion.panel_names), case.copies)
    watch = _Watch(case, on_progress, cancelled)
    for cycle in range(1, case.run.cycles_max + 1):
        while solver.time < cycle / case.flapping_frequency:
            watch.stop_if_cancelled(solver.time)
            info = solver.step()
            recorder.add(info.time, info.pressure, info.viscous, info.power)
            watch.report(info, cycle)
            for observe in observers:
                observe(solver)
        if cycle >= case.run.cycles and _periodic(case, recorder):
            break
    result = _result(case, solver, recorder, watch.wall(), device)
    if out is not None:
        write_run(Path(out), case, result)
    return result


def check_device(device: str) -> None:
    """Refuse a device that this program cannot use.

    Raises
    ------
    InputError
        Says what is allowed.
    """
    if device == "cuda":
        raise InputError("device 'cuda': this version computes on the CPU only; allowed: cpu")
    if device != "cpu":
        raise InputError(f"device '{device}' is unknown; allowed: cpu")


def header(case: Case) -> list[str]:
    """Return every setting of a case as lines ``key = value``, the operating point first."""
    lines = [f"case {case.preset}: {describe_point(case)}, address {case.address()}"]

    def walk(values: dict[str, object], prefix: str) -> None:
        for key, value in values.items():
            if isinstance(value, dict):
                walk(value, f"{prefix}{key}.")
            else:
                lines.append(f"  {prefix}{key} = {value}")

    walk(to_mapping(case), "")
    return lines


class _Watch:
    """Tells the caller how far the run is, and listens for cancellation."""

    def __init__(
        self, case: Case, on_progress: OnProgress | None, cancelled: Callable[[], bool] | None
    ) -> None:
        self._case, self._on_progress, self._cancelled = case, on_progress, cancelled
        self._started = time.perf_counter()
        self._interval = 1.0 / (_REPORTS_PER_CYCLE * case.flapping_frequency)
        self._next = 0.0
        self._time = 0.0
        self._cycle, self._impulse, self._begin = 1, 0.0, 0.0
        self._mean_lift = float("nan")

    def wall(self) -> float:
        """Seconds since the run started."""
        return time.perf_counter() - self._started

    def stop_if_cancelled(self, now: float) -> None:
        if self._cancelled is not None and self._cancelled():
            done = now * self._case.flapping_frequency
            raise CancelledError(f"cancelled after {done:.2f} cycles ({describe_point(self._case)})")

    def report(self, info: StepInfo, cycle: int) -> None:
        lift = self._case.copies * float(info.pressure[:, 2].sum() + info.viscous[:, 2].sum())
        if not np.isfinite(lift):
            raise WorkError(
                f"the flow became undefined at t = {info.time:.5f} s ({describe_point(self._case)})"
            )
        self._follow_mean(info.time, lift, cycle)
        if self._on_progress is None or info.time < self._next:
            return
        self._next = info.time + self._interval
        cycles = max(cycle, self._case.run.cycles)
        fraction = min(1.0, info.time * self._case.flapping_frequency / cycles)
        left = self.wall() * (1.0 / fraction - 1.0) if fraction > 0 else float("nan")
        drag = self._case.copies * float(info.pressure[:, 0].sum() + info.viscous[:, 0].sum())
        power = self._case.copies * float(np.sum(info.power))
        self._on_progress(
            Progress(fraction, cycle, cycles, info.time, lift, left, drag, power, self._mean_lift)
        )

    def _follow_mean(self, now: float, lift: float, cycle: int) -> None:
        """Integrate the lift; `now` is the end of a step that belongs to `cycle`."""
        if cycle > self._cycle:
            self._mean_lift = self._impulse / (self._time - self._begin)
            self._cycle, self._impulse, self._begin = cycle, 0.0, self._time
        self._impulse += lift * (now - self._time)
        self._time = now


def _binned(case: Case, history: History) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Lift, drag and power averaged over the parts of each complete cycle."""
    lift, drag, power = (
        phase_bins(history.time, signal, case.flapping_frequency)
        for signal in (history.lift(), history.drag(), history.total_power())
    )
    return lift, drag, power


def _periodic(case: Case, recorder: Recorder) -> bool:
    lift, drag, _ = _binned(case, recorder.history())
    return is_periodic(lift, drag, case.run.periodic_within)


def _result(case: Case, solver: Solver, recorder: Recorder, wall: float, device: str) -> LiftResult:
    history = recorder.history()
    binned = _binned(case, history)
    lift, drag, power = (cycle_mean(signal, case.run.discard) for signal in binned)
    steps = len(history.time)
    return LiftResult(
        flapping_frequency=case.flapping_frequency,
        angle_of_attack_deg=case.angle_of_attack_deg,
        airspeed=case.airspeed,
        mean_lift=lift.mean,
        lift_std=lift.std,
        mean_drag=drag.mean,
        drag_std=drag.std,
        mean_power=power.mean,
        cycle_lift=lift.per_cycle,
        cycles=len(lift.per_cycle),
        periodic=is_periodic(binned[0], binned[1], case.run.periodic_within),
        dp=case.flow.resolution.dp,
        particles=solver.particles,
        steps=steps,
        wall_s=wall,
        particle_steps_per_s=solver.particles * steps / wall,
        device=device,
        preset=case.preset,
        address=case.address(),
        half_model=case.flow.box.symmetric,
        provenance=Provenance.here(case.solver),
        history=history,
    )
