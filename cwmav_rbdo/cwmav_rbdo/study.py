# SPDX-License-Identifier: Apache-2.0
"""One study from its problem to its run folder, whoever evaluates: the library's and the programs' way in."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from cwmav_common.errors import CancelledError, InputError
from cwmav_rbdo import noise as scatter
from cwmav_rbdo.artefacts import write_artefacts
from cwmav_rbdo.dispatch import Evaluator, evaluate_all
from cwmav_rbdo.evaluation import Evaluation
from cwmav_rbdo.executors import problem_evaluator
from cwmav_rbdo.general_problem import GeneralProblem
from cwmav_rbdo.journal import Journal
from cwmav_rbdo.loop import AcceleratedLoop
from cwmav_rbdo.noise import Noise
from cwmav_rbdo.problem import Problem, digest, problem_mapping
from cwmav_rbdo.result import IterationRow, Result
from cwmav_rbdo.run_folder import RunFolder
from cwmav_rbdo.wing_problem import WingProblem


def run_study(
    problem: Problem,
    evaluator: Evaluator | None = None,
    *,
    seed: int = 0,
    run_folder: RunFolder | None = None,
    resume: bool = False,
    noise: Noise | None = None,
    on_iteration: Callable[[IterationRow], None] = lambda row: None,
    cancelled: Callable[[], bool] = lambda: False,
) -> Result:
    """Solve a problem.

    Parameters
    ----------
    problem : wing study or general problem
    evaluator : who evaluates points; None: what the problem asks for, without ROS
    seed : of everything random; the same seed gives the same result bit for bit
    run_folder : where everything is written; None: nothing is
    resume : continue the run in `run_folder`
    noise : scatter of the control variables of a wing study; None: as the problem says
    on_iteration : told every new row of the history
    cancelled : asked several times a second while points are evaluated

    Returns
    -------
    Result
        Also when nothing converged or no design is feasible; its message says which.

    Raises
    ------
    InputError
        Problem and evaluator or run folder do not fit.
    WorkError
        The evaluations failed; :class:`~cwmav_common.errors.CancelledError` when cancelled. The journal
        stays.
    """
    if isinstance(problem, GeneralProblem):
        from cwmav_rbdo.general.study import run_general_study

        return run_general_study(
            problem, evaluator, seed=seed, run_folder=run_folder, resume=resume, cancelled=cancelled
        )
    if resume:
        if run_folder is None:
            raise InputError("resume needs a run folder")
        noise = scatter.from_json(run_folder.read_config()["noise"])
    noise = noise or scatter.obtain(problem)
    own = problem_evaluator(problem) if evaluator is None else None
    try:
        chosen: Evaluator = evaluator or own  # type: ignore[assignment]
        if problem.batch_size == 0:
            problem = replace(problem, batch_size=_batch(chosen, run_folder, resume))
        with closing(open_journal(problem, seed, noise, run_folder, resume)) as journal:
            loop = AcceleratedLoop(problem, noise, np.random.default_rng(seed), journal)
            _drive(loop, chosen, run_folder, on_iteration, cancelled)
            result = loop.result(seed)
            if run_folder is not None:
                write_artefacts(run_folder, loop, result)
            return result
    finally:
        if own is not None:
            own.close()


def _batch(evaluator: Evaluator, run_folder: RunFolder | None, resume: bool) -> int:
    """Points of a round where the problem leaves it open; a resumed run keeps what it began with."""
    if resume and run_folder is not None:
        return int(run_folder.read_config()["problem"]["batch_size"])
    return max(1, evaluator.workers)


def open_journal(
    problem: WingProblem, seed: int, noise: Noise, run_folder: RunFolder | None, resume: bool
) -> Journal:
    """Open the journal of a run, after writing the settings of a new one."""
    header = {
        "problem": digest(problem),
        "seed": seed,
        "noise": {name: noise.std(name) for name in noise.scatter},
    }
    if run_folder is not None and not resume:
        run_folder.write_config(
            {
                "program": "cwmav-rbdo",
                "version": program_version(),
                "seed": seed,
                "problem": problem_mapping(problem),
                "noise": noise.to_json(),
            }
        )
    path = None if run_folder is None else run_folder.journal
    return Journal(path, header, Evaluation, resume=resume)


def _drive(
    loop: AcceleratedLoop,
    evaluator: Evaluator,
    run_folder: RunFolder | None,
    on_iteration: Callable[[IterationRow], None],
    cancelled: Callable[[], bool],
) -> None:
    seen = 0
    while True:
        if cancelled():
            raise CancelledError("cancelled between evaluations; the journal is kept")
        requests = loop.ask()
        for row in loop.iterations[seen:]:
            on_iteration(row)
        if run_folder is not None and len(loop.iterations) > seen:
            run_folder.write_iterations([row.to_json() for row in loop.iterations])
        seen = len(loop.iterations)
        if not requests:
            return
        evaluate_all(requests, evaluator, loop.problem.dispatch, loop.tell, cancelled=cancelled)


def program_version() -> str:
    """Version of the installed suite."""
    try:
        return version("cwmav")
    except PackageNotFoundError:
        return "unknown"
