# SPDX-License-Identifier: Apache-2.0
"""``run.mcap`` of a study without ROS: the iteration messages that the node would have published."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cwmav_common import interfaces
from cwmav_common.mcap_writer import BagWriter
from cwmav_rbdo.loop import AcceleratedLoop
from cwmav_rbdo.result import IterationRow
from cwmav_rbdo.wing_problem import WingProblem

TOPIC = "/optimiser/iteration"
TYPE = "cwmav_msgs/msg/OptimiserIteration"


def write_recording(path: Path, loop: AcceleratedLoop, run: str) -> None:
    """Write one message per iteration, in order, with the time of writing."""
    with BagWriter(path) as bag:
        bag.add_metadata("cwmav", {"run": run, "program": "cwmav-rbdo"})
        bag.add_topic(TOPIC, TYPE, latched=True)
        stamp = time.time_ns()
        for row in loop.iterations:
            bag.write(
                TOPIC,
                TYPE,
                iteration_message(loop.problem, row, run, stamp + row.iteration),
                stamp + row.iteration,
            )


def iteration_message(problem: WingProblem, row: IterationRow, run: str, stamp_ns: int) -> Any:
    """Make the message of one row, angles in rad."""
    return interfaces.new(
        TYPE,
        header=interfaces.header(stamp_ns),
        run=run,
        iteration=row.iteration,
        design=_point(problem, row.x),
        lift_to_power=row.prediction,
        lift_to_power_std=row.prediction_std,
        mse=row.mse,
        max_mse=row.max_mse,
        error_percent=100.0 * row.error,
        reliability=row.reliability.value,
        reliability_std=row.reliability.std,
        reliability_interval=np.array([row.reliability.low, row.reliability.high]),
        window_lower=_point(problem, row.window_lower),
        window_upper=_point(problem, row.window_upper),
        evaluations=row.evaluations,
        converged=row.converged,
    )


def _point(problem: WingProblem, x: NDArray[np.float64]) -> dict[str, float]:
    f, a, u = problem.control_point(x).tolist()
    return {"flapping_frequency": f, "angle_of_attack": a, "forward_velocity": u}
