# SPDX-License-Identifier: Apache-2.0
"""Run one case: from settings to mean lift."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import CancelledError, WorkError
from cwmav_common.settings import to_mapping
from cwmav_sim.balance import Ledger, WingInertia, cost, mean_parts
from cwmav_sim.case import Case, check_inside
from cwmav_sim.checkpoint import Checkpoint
from cwmav_sim.coupling import CoupledWings
from cwmav_sim.devices import AirSolver, card_name, check_device, make_solver
from cwmav_sim.export import write_run
from cwmav_sim.gauges import History, Recorder, cycle_mean, is_periodic, phase_bins
from cwmav_sim.result import LiftResult, Provenance, describe_point
from cwmav_sim.solver import StepInfo
from cwmav_sim.warm import EndState, fill
from cwmav_sim.wing.sheet import FloatArray

logger = logging.getLogger(__name__)

_REPORTS_PER_CYCLE = 50
_MARKS_PER_CYCLE = 8


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
Observer = Callable[[AirSolver], None]


def simulate(
    case: Case,
    *,
    on_progress: OnProgress | None = None,
    cancelled: Callable[[], bool] | None = None,
    out: str | Path | None = None,
    resume: bool = False,
    observers: Sequence[Observer] = (),
    device: str = "cpu",
    start: EndState | None = None,
    keep_state: Path | None = None,
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
        Folder that receives ``result.json``, ``history.csv``, ``phases.csv`` and ``config.yaml``, and a
        checkpoint eight times per cycle until the run is done.
    resume : bool
        Go on from the checkpoint in ``out`` where there is one; the result has the same bits as without the
        interruption.
    observers : sequence of callables
        Called with the solver after every step, for snapshots and pictures.
    device : {"cpu", "cuda"}
        Where to compute; the content address does not depend on it, the result says it.
    start : EndState, optional
        The air that the run ``case.run.start_from`` left; see :func:`cwmav_sim.warm.started`.
    keep_state : Path, optional
        Folder in which to leave the air at the end, so that other cases can start from it.

    Returns
    -------
    LiftResult
        With its history.

    Raises
    ------
    InputError
        For a device that is not there, a checkpoint of another case, or a start that does not fit.
    WorkError
        When the flow blows up; :class:`~cwmav_common.errors.CancelledError` when cancelled.
    """
    check_device(device)
    for line in header(case):
        logger.info(line)
    work = _Work(case, device, on_progress, cancelled)
    checkpoint = None if out is None else Checkpoint(Path(out), case.address())
    saved = checkpoint.read() if resume and checkpoint is not None else None
    work.begin(saved, start)
    for cycle in range(1, case.run.cycles_max + 1):
        while work.solver.time < cycle / case.flapping_frequency:
            work.step(cycle)
            for observe in observers:
                observe(work.solver)
            if work.reached_mark() and checkpoint is not None:
                checkpoint.write(work.save())
        if cycle >= case.run.cycles and _periodic(case, work.recorder):
            break
    result = _result(case, work, device)
    if keep_state is not None:
        EndState.of(case, work.solver).write(keep_state)
    if out is not None and checkpoint is not None:
        write_run(Path(out), case, result)
        checkpoint.remove()
    return result


class _Work:
    """A run in progress: air, wings, what is recorded of them, and who watches."""

    def __init__(
        self,
        case: Case,
        device: str,
        on_progress: OnProgress | None,
        cancelled: Callable[[], bool] | None,
    ) -> None:
        self.case, self.motion = case, case.motion()
        self.solver = make_solver(
            device, case.flow, self.motion, case.airspeed, highest_speed=case.highest_speed()
        )
        self.recorder = Recorder(len(self.motion.panel_names), case.copies)
        self.watch = _Watch(case, on_progress, cancelled)
        self.inertia = WingInertia(case, self.motion)
        self.ledger = Ledger.of(self.solver)
        self._mark = 0

    def step(self, cycle: int) -> None:
        """Advance by one step and record it."""
        self.watch.stop_if_cancelled(self.solver.time)
        info = self.solver.step()
        nodes = self.solver.sheet
        if self.case.flexible and nodes is not None:
            check_inside(self.case, nodes.x, self.solver.time)
        inertial = self.inertia.force(nodes, info.dt)
        self.recorder.add(info.time, info.pressure, info.viscous, info.power, info.moment, inertial)
        self.ledger.add(info.dt, info.power)
        self.watch.report(info, cycle)

    def reached_mark(self) -> bool:
        """Tell whether a mark is reached at which runs can be continued, and make that possible."""
        if self.solver.time * self.case.flapping_frequency * _MARKS_PER_CYCLE < self._mark + 1:
            return False
        self._mark = int(self.solver.time * self.case.flapping_frequency * _MARKS_PER_CYCLE)
        if isinstance(self.motion, CoupledWings):
            self.motion.settle()
        return True

    def save(self) -> dict[str, NDArray]:
        """Return everything needed to go on from here."""
        time, rows = self.recorder.rows()
        parts = {
            "air": self.solver.save(),
            "wings": self.motion.save() if isinstance(self.motion, CoupledWings) else {},
            "history": {"time": time, "rows": rows},
            "watch": self.watch.save(),
            "inertia": self.inertia.save(),
            "ledger": self.ledger.save(),
            "mark": {"number": np.array(self._mark)},
        }
        return {f"{part}/{name}": v for part, values in parts.items() for name, v in values.items()}

    def begin(self, saved: dict[str, NDArray] | None, start: EndState | None) -> None:
        """Go to a saved instant, or to the air that another run left; without both, air at rest stays."""
        if saved is not None:
            self._restore(saved)
        elif self.case.run.start_from or start is not None:
            fill(self.solver, self.case, start)
            self.ledger = Ledger.of(self.solver)

    def _restore(self, saved: dict[str, NDArray]) -> None:
        parts: dict[str, dict[str, NDArray]] = {}
        for key, value in saved.items():
            part, _, name = key.partition("/")
            parts.setdefault(part, {})[name] = value
        self.solver.restore(parts["air"])
        if isinstance(self.motion, CoupledWings):
            self.motion.restore(parts["wings"])
        self.recorder.refill(parts["history"]["time"], parts["history"]["rows"])
        self.watch.restore(parts["watch"])
        self.inertia.restore(parts["inertia"])
        self.ledger.restore(parts["ledger"])
        self._mark = int(parts["mark"]["number"])


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
        self._started, self._earlier = time.perf_counter(), 0.0
        self._interval = 1.0 / (_REPORTS_PER_CYCLE * case.flapping_frequency)
        self._next = 0.0
        self._time = 0.0
        self._cycle, self._impulse, self._begin = 1, 0.0, 0.0
        self._mean_lift = float("nan")

    def wall(self) -> float:
        """Seconds spent on the run, interruptions left out."""
        return self._earlier + time.perf_counter() - self._started

    def save(self) -> dict[str, NDArray]:
        """Return what is followed between reports."""
        values = (self._next, self._time, self._cycle, self._impulse, self._begin, self._mean_lift)
        return {"values": np.array([*values, self.wall()])}

    def restore(self, saved: dict[str, NDArray]) -> None:
        """Go on following."""
        self._next, self._time, cycle, self._impulse, self._begin, self._mean_lift, self._earlier = (
            float(v) for v in saved["values"]
        )
        self._cycle = int(cycle)

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


def _result(case: Case, work: _Work, device: str) -> LiftResult:
    solver, history, wall = work.solver, work.recorder.history(), work.watch.wall()
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
        details={
            "parts": mean_parts(history, case.flapping_frequency, case.run.discard),
            "balance": work.ledger.balance(solver, work.motion, case),
            "cost": cost(solver, steps, wall, card_name(device)),
        },
    )
