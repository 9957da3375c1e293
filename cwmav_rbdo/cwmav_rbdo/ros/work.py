# SPDX-License-Identifier: Apache-2.0
"""Work of the node's process: one study, whose points are evaluated by asking the node."""

from __future__ import annotations

from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cwmav_rbdo.noise import Noise
from cwmav_rbdo.problem import parse_text
from cwmav_rbdo.result import Result
from cwmav_rbdo.run_folder import RunFolder
from cwmav_rbdo.study import run_study
from cwmav_rbdo.wing_problem import WingProblem


@dataclass(frozen=True)
class AskPoint:
    """Lift and power of a control point, please: F [Hz], AoA [rad], U [m/s]; an Evaluation is the answer."""

    point: NDArray[np.float64]


@dataclass(frozen=True)
class AskWorkers:
    """The number of points that may be asked for at once, please."""


@dataclass(frozen=True)
class AskNoise:
    """The scatter of the control variables, please; a Noise is the answer."""


class Channel(Protocol):
    """How the work reports, asks, and hears that it should stop."""

    def report(self, value: object) -> None:
        """Hand a value to the node."""
        ...

    def ask(self, question: object) -> Future[Any]:
        """Put a question to the node."""
        ...

    def cancelled(self) -> bool:
        """Say whether to stop."""
        ...


class AskingEvaluator:
    """Evaluator that passes every point on to the node."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._workers: int = channel.ask(AskWorkers()).result()

    @property
    def workers(self) -> int:
        """How many points the simulation node works on at the same time."""
        return self._workers

    def submit(self, point: NDArray[np.float64]) -> Future[Any]:
        """Ask for one point."""
        return self._channel.ask(AskPoint(point))

    def close(self) -> None:
        """Nothing to give back."""


def optimise(text: str, seed: int, folder: str, resume: bool, channel: Channel) -> Result:
    """Run the study of a problem text; iterations are reported as they come."""
    problem = parse_text(text)
    evaluator = noise = None
    if isinstance(problem, WingProblem) and problem.evaluate == "ros":
        evaluator = AskingEvaluator(channel)
        noise = None if resume else _noise(problem, channel)  # a resumed run keeps the noise it began with
    return run_study(
        problem,
        evaluator,
        seed=seed,
        run_folder=RunFolder(Path(folder)),
        resume=resume,
        noise=noise,
        on_iteration=channel.report,
        cancelled=channel.cancelled,
    )


def _noise(problem: WingProblem, channel: Channel) -> Noise | None:
    """Ask for the scatter when the problem says that it is measured."""
    if problem.noise is not None:
        return None
    noise: Noise = channel.ask(AskNoise()).result()
    return noise
