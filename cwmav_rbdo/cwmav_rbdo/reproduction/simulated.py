# SPDX-License-Identifier: Apache-2.0
"""Runs of the solver at the points of the paper's lift tables, kept so that an interrupted set goes on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from cwmav_common.errors import InputError, WorkError
from cwmav_rbdo.reproduction.tables import NAMES, paper_table

_LIFTS = ("table1", "table3")


@dataclass(frozen=True)
class Runs:
    """How to simulate the rows.

    Attributes
    ----------
    folder : Path
        Where results are kept.
    preset : str
        Preset of the runs.
    assignments : tuple of str
        Settings ``key=value`` that change it.
    incidence_offset_deg : float
        Added to every printed angle of attack of table 3.
    """

    folder: Path
    preset: str = "coarse"
    assignments: tuple[str, ...] = ()
    incidence_offset_deg: float = 0.0

    def describe(self) -> str:
        """Say the settings in one line."""
        offset = self.incidence_offset_deg
        said = [f"incidence offset {offset:g} deg"] if offset else []
        return ", ".join([f"preset {self.preset}", *self.assignments, *said])


def simulate_rows(names: Sequence[str], runs: Runs, on_case: Callable[[int, int, str], None]) -> Path:
    """Run every point of the named lift tables that is not in the folder yet; return the CSV of the results.

    Parameters
    ----------
    names : sequence of str
        Tables asked for; only 1 and 3 hold lifts.
    runs : Runs
        Where and how.
    on_case : callable
        Told after each case its number from 1, how many there are, and what came out.

    Raises
    ------
    InputError
        For a preset or setting that is not allowed, or when no table of lifts is asked for.
    WorkError
        When every run fails.
    """
    from cwmav_sim import case as cases
    from cwmav_sim import sweep
    from cwmav_sim.result import LiftResult
    from cwmav_sim.run import simulate
    from cwmav_sim.runners import InProcess
    from cwmav_sim.store import ResultStore

    points = _points(names, runs.incidence_offset_deg)
    base = cases.with_overrides(cases.preset(runs.preset), runs.assignments)
    wanted = sweep.cases_of(base, points)
    runs.folder.mkdir(parents=True, exist_ok=True)
    cases.dump_case(base, runs.folder / "config.yaml")

    def keep(number: int, outcome: LiftResult | sweep.Failure) -> None:
        lift = (
            f"{outcome.mean_lift:.4f} N" if isinstance(outcome, LiftResult) else f"failed: {outcome.reason}"
        )
        on_case(number + 1, len(wanted), lift)

    found = sweep.sweep(
        wanted,
        ResultStore(runs.folder / "store"),
        InProcess(lambda case: simulate(case, out=runs.folder / "runs" / case.address(), resume=True)),
        keep,
    )
    if not found.results:
        raise WorkError(f"{runs.folder}: every run failed; the first: {found.failed[0].reason}")
    path = runs.folder / "sweep.csv"
    sweep.write_table(found.results, path)
    return path


def _points(names: Sequence[str], offset_deg: float) -> list[tuple[float, float, float]]:
    rows = [
        row | {"AoA_deg": round(row["AoA_deg"] + (offset_deg if name == "table3" else 0.0), 6)}
        for name in names
        if name in _LIFTS
        for row in paper_table(NAMES[name])
    ]
    if not rows:
        raise InputError(f"--simulate is for tables of lifts; allowed: {', '.join(_LIFTS)}, all")
    return list(dict.fromkeys((row["F_hz"], row["AoA_deg"], row["U_m_s"]) for row in rows))
