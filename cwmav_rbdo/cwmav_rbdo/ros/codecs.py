# SPDX-License-Identifier: Apache-2.0
"""Values of the optimiser as messages, and the rig's estimate as noise."""

from __future__ import annotations

import math

from cwmav_msgs.action import Optimise
from cwmav_msgs.msg import OptimiserIteration, UncertaintyEstimate
from std_msgs.msg import Header

from cwmav_common.cli import to_json
from cwmav_common.errors import WorkError
from cwmav_common.ros.codecs import control_point
from cwmav_rbdo.noise import Noise, Scatter
from cwmav_rbdo.result import IterationRow, Result
from cwmav_rbdo.wing_problem import CONTROLS, WingProblem

_FIELDS = {"F": "flapping_frequency", "AoA": "angle_of_attack", "U": "forward_velocity"}


def noise_of(estimate: UncertaintyEstimate) -> Noise:
    """Make the noise from the rig's estimate.

    Raises
    ------
    WorkError
        The scatter of one of the control variables was not recorded.
    """
    scatter = {}
    for index, (name, (_, factor)) in enumerate(CONTROLS.items()):
        field = _FIELDS[name]
        std = getattr(estimate, f"{field}_std") / factor
        if not math.isfinite(std):
            raise WorkError(
                f"{estimate.source}: no scatter of {name} was measured; give the noise in the problem"
            )
        low, high = (float(value) / factor for value in getattr(estimate, f"{field}_std_interval"))
        mean = getattr(estimate, f"{field}_mean") / factor
        scatter[name] = Scatter(std, low, high, mean, estimate.distribution[index] or "normal")
    mark = " (synthetic)" if estimate.synthetic else ""
    return Noise(scatter, f"measured on {estimate.source}{mark}, {estimate.cycles} cycles")


def iteration(header: Header, run: str, problem: WingProblem, row: IterationRow) -> OptimiserIteration:
    """Make the message of one row of the history."""
    return OptimiserIteration(
        header=header,
        run=run,
        iteration=row.iteration,
        design=control_point(problem.control_point(row.x)),
        lift_to_power=float(row.prediction),
        lift_to_power_std=float(row.prediction_std),
        mse=float(row.mse),
        max_mse=float(row.max_mse),
        error_percent=100.0 * float(row.error),
        reliability=float(row.reliability.value),
        reliability_std=float(row.reliability.std),
        reliability_interval=[float(row.reliability.low), float(row.reliability.high)],
        window_lower=control_point(problem.control_point(row.window_lower)),
        window_upper=control_point(problem.control_point(row.window_upper)),
        evaluations=row.evaluations,
        converged=bool(row.converged),
    )


def result_message(problem: WingProblem, result: Result, folder: str) -> Optimise.Result:
    """Make the result of the action."""
    band = result.constraints[0].band
    values = problem.fixed | dict(result.design)
    point = [values[name] * factor for name, (_, factor) in CONTROLS.items()]
    return Optimise.Result(
        success=True,
        message=result.message,
        converged=bool(result.converged),
        design=control_point(point),
        lift_to_power=float(result.extra.get("lift_to_power", result.objective)),
        lift_to_power_std=float(result.extra.get("lift_to_power_std", result.objective_std)),
        reliability=float(band.value),
        reliability_interval=[float(band.low), float(band.high)],
        iterations=result.iterations,
        evaluations=result.true_evaluations,
        run_folder=folder,
        result_json=to_json(result.to_json(), indent=None),
    )
