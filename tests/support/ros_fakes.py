# SPDX-License-Identifier: Apache-2.0
"""Stand-ins for slow cores, importable by the worker processes. The control point says what they do."""

from __future__ import annotations

import os
import signal
import time
from typing import Any

from cwmav_common.errors import CancelledError, InputError, WorkError

HANG, DIE, REFUSE, FAIL = 29.0, 28.0, 27.0, 26.0  # flapping frequencies [Hz]


def hang(channel: Any) -> None:
    """Work until cancelled."""
    while not channel.cancelled():
        time.sleep(0.01)
    raise CancelledError("cancelled, as asked")


def misbehave(what: float, channel: Any) -> None:
    """Do what a flapping frequency stands for; nothing for others."""
    if what == HANG:
        hang(channel)
    elif what == DIE:
        os.kill(os.getpid(), signal.SIGKILL)
    elif what == REFUSE:
        raise InputError("refused, as asked")
    elif what == FAIL:
        raise WorkError("failed, as asked")


def double(number: float, channel: Any) -> float:
    """Report the number, then give twice of it, or misbehave."""
    channel.report(number)
    misbehave(number, channel)
    return 2 * number


def ask_back(question: Any, channel: Any) -> Any:
    """Give what the submitter answers."""
    return channel.ask(question).result(timeout=30)


def process_number(channel: Any) -> int:
    """Give the id of the worker's process."""
    del channel
    return os.getpid()


def surprise(channel: Any) -> None:
    """Raise what nobody expects."""
    del channel
    raise ZeroDivisionError("surprise")


class FakeTable:
    """Lift equal to the flapping frequency in mN, inside up to 20 Hz; refuses more than 30 Hz."""

    def __init__(self, path: str = "") -> None:
        self.path = path

    def lift(self, flapping_frequency: float, angle_of_attack: float, airspeed: float) -> Any:
        """Answer, or refuse as the real table does."""
        from cwmav_sim.table import LiftEstimate

        if flapping_frequency > 30.0:
            raise InputError(f"F is {flapping_frequency:g} Hz; allowed: 4 to 30 Hz")
        return LiftEstimate(1e-3 * flapping_frequency, 1e-4, "fake table", flapping_frequency <= 20.0)


def live(case: Any, store: Any, device: str, view: Any, channel: Any) -> tuple[Any, bool]:
    """Stand in for a live run: reports what a run reports, and misbehaves by flapping frequency."""
    import numpy as np

    from cwmav_sim.ros.live import Cloud, Surface
    from cwmav_sim.run import Progress
    from support.sim_results import result_for

    motion = case.motion()
    nodes = motion.state(0.0).x.astype(np.float32)
    channel.report(Surface(nodes, motion.triangles, motion.panel, motion.panel_names))
    if view.particle_share:
        channel.report(Cloud(nodes, 0 * nodes, np.arange(len(nodes), dtype=np.float32)))
    for step in (1, 2):
        channel.report(Progress(0.5 * step, step, 2, 0.1 * step, 0.2, 3.0, 0.02, 0.4, 0.19))
    misbehave(case.flapping_frequency, channel)
    return result_for(case, 1e-2 * case.angle_of_attack_deg), False


def study(text: str, seed: int, folder: str, resume: bool, channel: Any) -> Any:
    """Stand in for a study: asks for noise and two points, reports two rows; misbehaves by seed."""
    import numpy as np

    from cwmav_rbdo.problem import parse_text
    from cwmav_rbdo.result import Band, Constraint, IterationRow, Result
    from cwmav_rbdo.ros.work import AskNoise, AskPoint, AskWorkers

    problem = parse_text(text)
    misbehave(seed, channel)
    workers = channel.ask(AskWorkers()).result(60)
    noise = channel.ask(AskNoise()).result(60)
    designs = [np.array([10.0, 20.0]), np.array([12.0, 22.0])]
    asked = [channel.ask(AskPoint(problem.control_point(x))) for x in designs]
    answers = [question.result(60) for question in asked]
    band = Band(0.998, 1e-4, 0.997, 0.999, "fake")
    for number, (x, answer) in enumerate(zip(designs, answers, strict=True)):
        row = IterationRow(
            iteration=number,
            names=problem.names,
            x=x,
            prediction=answer.lift_to_power,
            prediction_std=0.01,
            response=1.1 * answer.lift_to_power,
            response_std=0.01,
            mse=1e-4,
            max_mse=2e-4,
            reliability=band,
            feasible=True,
            window_lower=x - 1.0,
            window_upper=x + 1.0,
            evaluations=number + 7,
            converged=number == 1,
        )
        channel.report(row)
    return Result(
        id=problem.id,
        kind=problem.kind,
        design=problem.named(designs[-1]),
        units=dict(zip(problem.names, problem.units, strict=True)),
        objective=answers[-1].lift_to_power,
        objective_std=0.01,
        constraints=(Constraint("L/P", band, 0.9974),),
        iterations=1,
        true_evaluations=8,
        converged=True,
        feasible=True,
        message="as asked",
        history=(),
        seed=seed,
        extra={
            "workers": workers,
            "noise": noise.to_json(),
            "sources": [answers[0].lift_source, answers[0].power_source],
            "resumed": resume,
            "folder": folder,
        },
    )
