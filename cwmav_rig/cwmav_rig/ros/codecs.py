# SPDX-License-Identifier: Apache-2.0
"""Values of the rig as messages."""

from __future__ import annotations

import math
from typing import Any

from cwmav_msgs.msg import UncertaintyEstimate
from cwmav_msgs.srv import EstimateUncertainty, EvaluatePower
from std_msgs.msg import Header

from cwmav_common.ros.codecs import time_message
from cwmav_rig.analysis import RigReport
from cwmav_rig.power_model import PowerEstimate

_QUANTITIES = {
    "flapping_frequency": "flapping_frequency",
    "angle_of_attack": "angle_of_attack",
    "forward_velocity": "airspeed",
}


def uncertainty(report: RigReport) -> UncertaintyEstimate:
    """Make the estimate of a report; what was not recorded is NaN."""
    values: dict[str, Any] = {}
    distributions = []
    for name, attribute in _QUANTITIES.items():
        spread = getattr(report, attribute)
        values[f"{name}_mean"] = math.nan if spread is None else float(spread.mean)
        values[f"{name}_std"] = math.nan if spread is None else float(spread.std)
        low, high = (math.nan, math.nan) if spread is None else (spread.std_low, spread.std_high)
        values[f"{name}_std_interval"] = [float(low), float(high)]
        distributions.append("" if spread is None else spread.distribution or "")
    return UncertaintyEstimate(
        header=Header(stamp=time_message(report.end_ns)),
        source=report.source,
        synthetic=bool(report.synthetic),
        cycles=int(report.cycles),
        distribution=distributions,
        **values,
    )


def uncertainty_response(report: RigReport) -> EstimateUncertainty.Response:
    """Answer a request with a report."""
    estimate = uncertainty(report)
    return EstimateUncertainty.Response(
        success=True,
        message="; ".join(report.problems),
        flapping_frequency_std=estimate.flapping_frequency_std,
        angle_of_attack_std=estimate.angle_of_attack_std,
        forward_velocity_std=estimate.forward_velocity_std,
        estimate=estimate,
    )


def no_uncertainty(error: BaseException) -> EstimateUncertainty.Response:
    """Say why there is no estimate."""
    return EstimateUncertainty.Response(
        success=False,
        message=str(error),
        flapping_frequency_std=math.nan,
        angle_of_attack_std=math.nan,
        forward_velocity_std=math.nan,
    )


def power_response(estimate: PowerEstimate) -> EvaluatePower.Response:
    """Answer a request with a power."""
    return EvaluatePower.Response(
        success=True, power=float(estimate.power), power_std=float(estimate.power_std), source=estimate.source
    )


def no_power(error: BaseException) -> EvaluatePower.Response:
    """Say why there is no power."""
    return EvaluatePower.Response(success=False, message=str(error), power=math.nan, power_std=math.nan)
