# SPDX-License-Identifier: Apache-2.0
"""Coarser runs that a wing study is given beforehand, as levels of the lift surrogate."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from cwmav_common.errors import InputError
from cwmav_rbdo.cokriging import WithCoarseRuns
from cwmav_rbdo.kriging import Kriging
from cwmav_rbdo.wing_problem import WingProblem

_SAME = 1e-3  # of a fixed control variable
_ONE_LEVEL = 8.0  # mm; spacing of runs that do not say theirs


def lift_surrogate(problem: WingProblem, settings: Kriging) -> Kriging | WithCoarseRuns:
    """Give the lift surrogate of a study: plain Kriging, or one that learns from coarser runs as well.

    Raises
    ------
    InputError
        The file of coarser runs cannot be used, or too few of its runs are at the fixed control variables.
    """
    if not problem.source.coarse_lifts:
        return settings
    from cwmav_rbdo.reproduction.lift_tables import read_cases  # deferred: the tables import the study

    path = Path(problem.source.coarse_lifts)
    columns = {"F": "F_hz", "AoA": "AoA_deg", "U": "U_m_s"}
    cases = [
        case
        for case in read_cases(path)
        if all(abs(getattr(case, columns[name]) - value) <= _SAME for name, value in problem.fixed.items())
    ]
    needed = len(problem.names) + 2
    if len(cases) < needed:
        fixed = ", ".join(f"{name} = {value:g}" for name, value in problem.fixed.items()) or "any setting"
        raise InputError(f"{path}: {len(cases)} runs at {fixed}; needed are at least {needed}")
    return WithCoarseRuns(
        np.array([[getattr(case, columns[name]) for name in problem.names] for case in cases]),
        np.array([case.lift for case in cases]),
        np.array([0.0 if math.isnan(case.lift_std) else case.lift_std**2 for case in cases]),
        np.array([_ONE_LEVEL if math.isnan(case.dp) else case.dp for case in cases]),
        settings,
        settings,
    )
