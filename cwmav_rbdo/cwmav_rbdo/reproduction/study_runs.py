# SPDX-License-Identifier: Apache-2.0
"""Runs of the paper's study on ``paper_surface``, many seeds of each; none kept in a folder is repeated."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Self

from cwmav_common.errors import InputError
from cwmav_rbdo.noise import Noise, Scatter
from cwmav_rbdo.problem import digest
from cwmav_rbdo.reproduction.surface import PaperSurface
from cwmav_rbdo.result import Result
from cwmav_rbdo.study import run_study
from cwmav_rbdo.wing_problem import WingProblem

NOISE = Noise(
    {"F": Scatter(0.153), "AoA": Scatter(0.462), "U": Scatter(0.05)},
    "standard deviations printed in the paper",
)


@dataclass(frozen=True)
class StudyRun:
    """What one run gave: the columns of Tables 5 to 7 and no more."""

    design: Mapping[str, float]
    """F [Hz], AoA [deg], U [m/s]; those that are variables."""
    objective: float
    """Predicted L/P [N/W] at the design."""
    objective_std: float
    iterations: int
    true_evaluations: int
    converged: bool
    history: Sequence[Mapping[str, Any]]

    @classmethod
    def of(cls, result: Result) -> Self:
        """Take what is needed out of a result."""
        return cls(**{f.name: getattr(result, f.name) for f in fields(cls)})


def study_runs(
    problem: WingProblem, seed: int, seeds: int, on_run: Callable[[], None], folder: Path | None = None
) -> list[StudyRun]:
    """Run a study for several seeds.

    Parameters
    ----------
    problem : settings of the study
    seed, seeds : the first seed, and how many
    on_run : called after every run
    folder : keeps a file per run; a run that is there is read; None: nothing is kept

    Raises
    ------
    InputError
        A file of the folder holds no run, or the folder cannot be written.
    """
    runs = []
    for k in range(seed, seed + seeds):
        path = (
            None if folder is None else folder / f"{problem.id}-{problem.method}-{digest(problem)}-{k}.json"
        )
        if path is not None and path.exists():
            run = _read(path)
        else:
            run = StudyRun.of(run_study(problem, PaperSurface(), seed=k, noise=NOISE))
            if path is not None:
                _write(path, run)
        runs.append(run)
        on_run()
    return runs


def _read(path: Path) -> StudyRun:
    try:
        return StudyRun(**json.loads(path.read_text(encoding="utf-8")))
    except (ValueError, TypeError):
        raise InputError(f"{path}: is no run of this study; delete it to have it run again") from None


def _write(path: Path, run: StudyRun) -> None:
    """Write a run complete or not at all; numbers read back as they were."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        part.write_text(json.dumps(asdict(run)), encoding="utf-8")
        part.replace(path)
    except OSError as error:
        raise InputError(f"{path.parent}: runs cannot be kept there ({error})") from None
