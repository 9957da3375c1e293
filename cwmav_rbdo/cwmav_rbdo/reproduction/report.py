# SPDX-License-Identifier: Apache-2.0
"""Chooses the tables to reproduce and writes them as lines for a person."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from cwmav_common.errors import InputError
from cwmav_common.progress import progress
from cwmav_rbdo.reproduction.lift_tables import read_cases, reproduce_table1, reproduce_table3
from cwmav_rbdo.reproduction.study_tables import reproduce_comparison, reproduce_history
from cwmav_rbdo.reproduction.tables import NAMES

_RUNS = {"table5": 1, "table6": 1, "table7": 4}


def chosen(name: str) -> list[str]:
    """Tables behind a name of the command line.

    Raises
    ------
    InputError
        There is no such table.
    """
    if name == "all":
        return list(NAMES)
    if name not in NAMES:
        raise InputError(f"table '{name}' is unknown; allowed: {', '.join(NAMES)}, all")
    return [name]


def reproduce(
    names: Sequence[str],
    cases: Path | None,
    seed: int,
    seeds: int,
    folder: Path | None = None,
    incidence_offset_deg: float = 0.0,
) -> dict[str, Any]:
    """Reproduce tables; for several of them the result holds a list under ``tables``.

    The runs of tables 5 to 7 are kept in the folder and read from there. The incidence offset is added to
    the angles of table 3 before our lifts are looked up.

    A table of lifts for which there is nothing to compare is an error when asked for alone, and noted among
    several.
    """
    lifts = read_cases(cases) if cases is not None else None
    found = []
    with progress(sum(seeds * _RUNS.get(name, 0) for name in names), "reproduce", "run") as bar:
        for name in names:
            try:
                found.append(_one(name, lifts, incidence_offset_deg, seed, seeds, bar.update, folder))
            except InputError as error:
                if len(names) == 1:
                    raise
                found.append({"table": name, "rows": [], "settings": {}, "decisions": [f"not done: {error}"]})
    if len(found) == 1:
        return found[0]
    rows = [{"table": t["table"], **row} for t in found for row in t["rows"]]
    return {
        "tables": found,
        "rows": rows,
        "settings": {t["table"]: t["settings"] for t in found},
        "decisions": list(dict.fromkeys(d for t in found for d in t["decisions"])),
    }


def lines(found: dict[str, Any]) -> Iterator[str]:
    """Give everything as text."""
    if "runs" in found:
        yield f"runs at the rows: {found['runs']}"
    for table in found.get("tables", [found]):
        yield f"{table['table']}   (paper | ours)"
        source = _common_source(table["rows"])
        if source is not None:
            yield f"  ours: {source}"
        for row in table["rows"]:
            difference = row.get("difference_percent")
            tail = f"   {difference:+.2f} %" if difference is not None else ""
            yield f"  {_cells(row['paper'])} | {_cells(_ours(row, source))}{tail}"
            if "counts" in row:
                yield f"    {row['model']}, {row['variables']} variables: {_cells(row['counts'])}"
        for key in ("optimum", "counts"):
            if key in table:
                yield f"  {key}: {_cells(table[key])}"
        yield "  decisions:"
        yield from (f"  - {decision}" for decision in table["decisions"])


def _one(
    name: str,
    lifts: Any,
    incidence_offset_deg: float,
    seed: int,
    seeds: int,
    on_run: Any,
    folder: Path | None,
) -> dict[str, Any]:
    if name == "table1":
        return reproduce_table1(lifts)
    if name == "table3":
        return reproduce_table3(lifts, incidence_offset_deg)
    if name == "table7":
        return reproduce_comparison(seed, seeds, lambda: on_run(1), folder)
    return reproduce_history(name, seed, seeds, lambda: on_run(1), folder)


def _common_source(rows: list[dict[str, Any]]) -> str | None:
    """Return where all our numbers come from, or None where they come from several places."""
    sources = {row["ours"].get("source") for row in rows if row.get("ours")}
    return sources.pop() if len(sources) == 1 else None


def _ours(row: dict[str, Any], source: str | None) -> dict[str, Any] | None:
    """Return our numbers as they are shown: the lift with its uncertainty, the source unless it is common."""
    if row.get("ours") is None:
        return None
    shown = {key: value for key, value in row["ours"].items() if key != "source" or source is None}
    if row.get("uncertainty_n") is not None:
        shown["lift_n"] = f"{_cell(shown['lift_n'])} +- {row['uncertainty_n']:.2g}"
    return shown


def _cells(values: Any) -> str:
    if values is None:
        return "-"
    return ", ".join(f"{key} {_cell(value)}" for key, value in values.items() if value is not None)


def _cell(value: Any) -> str:
    if isinstance(value, dict):
        return f"({_cells(value)})"
    return f"{value:.5g}" if isinstance(value, float) else str(value)
