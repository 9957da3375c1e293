# SPDX-License-Identifier: Apache-2.0
"""Fills the template of the report; numbers are formatted here, so the template holds no logic."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import jinja2

from cwmav_rbdo.loop import AcceleratedLoop
from cwmav_rbdo.problem import problem_mapping
from cwmav_rbdo.report import figures
from cwmav_rbdo.result import IterationRow, Result
from cwmav_rbdo.wing_problem import CONTROLS


def write_report(path: Path, loop: AcceleratedLoop, result: Result) -> None:
    """Write the report of a wing study as one HTML file without any outside reference."""
    text = (resources.files("cwmav_rbdo.report") / "report.html").read_text(encoding="utf-8")
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    path.write_text(environment.from_string(text).render(**content(loop, result)), encoding="utf-8")


def content(loop: AcceleratedLoop, result: Result) -> dict[str, Any]:
    """Give everything the template shows."""
    problem = loop.problem
    return {
        "id": result.id,
        "title": problem.title,
        "result": result,
        "design": ", ".join(
            f"{name} = {value:.4f} {result.units[name]}" for name, value in result.design.items()
        ),
        "objective": f"{result.objective:.4f} ± {result.objective_std:.4f}, {result.extra['objective_name']}",
        "reliability": _band(loop.iterations[-1]),
        "columns": [f"{name} [{unit}]" for name, unit in zip(problem.names, problem.units, strict=True)],
        "rows": [_row(row) for row in loop.iterations],
        "surfaces": list(figures.surfaces(loop)),
        "convergence": figures.convergence(loop),
        "reliability_figure": figures.reliability(loop),
        "noise": list(_noise(loop)),
        "noise_source": loop.noise.source,
        "sources": sorted(
            {s for e in loop.samples.evaluations for s in (e.lift_source, e.power_source) if s}
        ),
        "synthetic": any("synthetic" in e.power_source for e in loop.samples.evaluations),
        "settings": list(flat(problem_mapping(problem))),
    }


def flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Give settings as dotted keys and values."""
    for key, value in values.items():
        if isinstance(value, Mapping) and value:
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _band(row: IterationRow) -> str:
    r = row.reliability
    return f"{r.value:.5f}, between {r.low:.5f} and {r.high:.5f} as far as the surrogate knows"


def _row(row: IterationRow) -> list[str]:
    error = f"{100.0 * row.error:.2f}" if math.isfinite(row.error) else "-"
    return [
        str(row.iteration),
        *(f"{value:.4f}" for value in row.x),
        f"{row.prediction:.4f}",
        f"{row.response:.4f}" if math.isfinite(row.response) else "-",
        f"{row.mse:.2e}",
        f"{row.max_mse:.2e}",
        error,
        f"{row.reliability.value:.4f}",
        str(row.evaluations),
        ", ".join(
            name
            for name, holds in (("CC1", row.error_small), ("CC2", row.change_small), ("R", row.feasible))
            if holds
        ),
    ]


def _noise(loop: AcceleratedLoop) -> Iterator[list[str]]:
    for name, (unit, _) in CONTROLS.items():
        s = loop.noise.scatter[name]
        interval = f"{s.low:.4g} to {s.high:.4g}" if math.isfinite(s.low) else "-"
        mean = f"{s.mean:.4g}" if math.isfinite(s.mean) else "-"
        use = (
            "design variable"
            if name in loop.problem.names
            else f"fixed at {loop.problem.fixed[name]:g}, not used"
        )
        yield [f"{name} [{unit}]", mean, f"{s.std:.4g}", interval, s.distribution, use]
