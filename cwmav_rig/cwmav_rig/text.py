# SPDX-License-Identifier: Apache-2.0
"""A report of a recording as lines for a person."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cwmav_rig.report import RigReport
from cwmav_rig.uncertainty import Spread


def report_lines(report: RigReport) -> Iterator[str]:
    """Give one line per quantity: mean, standard deviation, its 95 % interval, distribution."""
    kind = "synthetic, " if report.synthetic else ""
    yield f"rig   {report.source} ({kind}{report.seconds:.0f} s)   {report.cycles} cycles"
    rows = (
        ("F", report.flapping_frequency, "Hz", 1.0, 2, 3),
        ("AoA", report.angle_of_attack, "deg", float(np.degrees(1.0)), 2, 3),
        ("U", report.airspeed, "m/s", 1.0, 2, 4),
        ("lift", report.lift, "N", 1.0, 4, 4),
        ("drag", report.drag, "N", 1.0, 4, 4),
        ("power", report.power, "W", 1.0, 3, 4),
    )
    for name, spread, unit, factor, digits, finer in rows:
        yield f"      {name:6s}{_numbers(spread, unit, factor, digits, finer)}"
    for name, clock in report.clocks.items():
        by = report.clock_notes.get(name, {}).get("method", "trigger")
        yield (
            f"      clock of {name}: {clock.offset * 1e3:+.3f} ms, {clock.skew * 1e6:+.1f} ppm,"
            f" residual {clock.residual * 1e3:.3f} ms, by {by}"
        )
    if report.rejected["cycles"]:
        yield f"      {report.rejected['cycles']} cycles left out: {report.rejected['reasons']}"


def budget_lines(report: RigReport) -> Iterator[str]:
    """Give the uncertainty budget of every mean, and the correlations between the quantities."""
    for budget in report.budgets.values():
        yield from budget.lines()
    found = report.correlations
    if found is not None:
        yield "correlation  " + " ".join(f"{name:>13s}" for name in found.names)
        for name, row, std in zip(found.names, found.matrix, found.std, strict=True):
            cells = " ".join(f"{r:6.2f} +- {s:.2f}" for r, s in zip(row, std, strict=True))
            yield f"    {name:9s}{cells}"


def _numbers(spread: Spread | None, unit: str, factor: float, digits: int, finer: int) -> str:
    if spread is None:
        return "not available"
    mean, std, low, high = (
        value * factor for value in (spread.mean, spread.std, spread.std_low, spread.std_high)
    )
    return (
        f"{mean:8.{digits}f} +- {std:.{finer}f} {unit:4s} [{low:.{finer}f}, {high:.{finer}f}]"
        f"   {spread.distribution or 'unknown'}"
    )
