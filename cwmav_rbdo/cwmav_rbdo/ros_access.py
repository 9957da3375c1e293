# SPDX-License-Identifier: Apache-2.0
"""Opens the evaluator over ROS services for the command line; ROS is imported only when it is asked for."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from cwmav_common.errors import InputError
from cwmav_rbdo.dispatch import Evaluator
from cwmav_rbdo.noise import Noise
from cwmav_rbdo.wing_problem import WingProblem


@contextmanager
def connect(problem: WingProblem, measure: bool) -> Iterator[tuple[Evaluator, Noise | None]]:
    """Open an evaluator on the running nodes, and measure the noise there when the problem says so.

    Raises
    ------
    InputError
        ROS is not installed here.
    """
    try:
        from cwmav_rbdo.ros.dispatch import ros_evaluator
    except ImportError as error:
        raise InputError(
            f"evaluate: ros needs ROS 2 and cwmav_msgs ({error}); without them use --evaluate local or table"
        ) from None
    with ros_evaluator() as evaluator:
        noise = evaluator.measure_noise().result() if measure and problem.noise is None else None
        yield evaluator, noise
