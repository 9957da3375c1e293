# SPDX-License-Identifier: Apache-2.0
"""Lines that a person reads while a study runs and at its end."""

from __future__ import annotations

import math
from collections.abc import Iterator

from cwmav_rbdo.result import IterationRow, Result
from cwmav_rbdo.wing_problem import WingProblem


def iteration_header(problem: WingProblem) -> str:
    """Heading of the iteration table."""
    names = "".join(f"{f'{n} [{u}]':>11}" for n, u in zip(problem.names, problem.units, strict=True))
    right = f"{'L/P [N/W]':>12}{'MSE':>11}{'max MSE':>11}{'error [%]':>11}{'reliability':>13}{'solves':>8}"
    return f" it{names}{right}"


def iteration_line(row: IterationRow) -> str:
    """One row of the iteration table."""
    design = "".join(f"{value:11.4f}" for value in row.x)
    error = f"{100.0 * row.error:11.2f}" if math.isfinite(row.error) else f"{'-':>11}"
    return (
        f"{row.iteration:3d}{design}{row.prediction:12.4f}{row.mse:11.2e}{row.max_mse:11.2e}{error}"
        f"{row.reliability.value:13.5f}{row.evaluations:8d}"
    )


def summary_lines(result: Result) -> list[str]:
    """Give the result in a few lines."""
    return list(_summary(result))


def _summary(result: Result) -> Iterator[str]:
    design = "   ".join(
        f"{name} {value:.5g} {result.units.get(name, '')}".rstrip() for name, value in result.design.items()
    )
    if result.kind == "lift_to_power":
        band = result.constraints[0].band
        objective = ""
        if not result.extra["objective_name"].startswith("L/P ["):
            objective = f"{result.extra['objective_name']} {result.objective:.4f}   "
        yield (
            f"optimum   {design}   {objective}"
            f"L/P {result.extra['lift_to_power']:.4f} +- {result.extra['lift_to_power_std']:.4f} N/W   "
            f"reliability {band.value:.4f} [{band.low:.4f}, {band.high:.4f}]"
        )
    elif result.design:
        yield f"optimum   {design}   objective {result.objective:.8g}"
        for c in result.constraints:
            verdict = "NOT met" if not c.met else "met" if c.band.value >= c.target else "met to that error"
            yield (
                f"          {c.name}: reliability {c.band.value:.6f} +- {c.band.std:.1e} "
                f"(required {c.target:.6f}) {verdict}"
            )
    outside = result.extra.get("outside_runs", 0)
    if outside:
        yield f"note      {outside} lifts lie outside of the runs of the lift table: extrapolated"
    yield f"status    {result.message}; {result.true_evaluations} points evaluated"
