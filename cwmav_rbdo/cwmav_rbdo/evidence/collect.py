# SPDX-License-Identifier: Apache-2.0
"""Runs every method on every study for many seeds, a line of JSON each; none is run twice.

A study on data that may be replaced, as the bundled lift table is from time to time, says in every line
which they were; on other data it is another study.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from cwmav_common.errors import CwmavError, InputError
from cwmav_rbdo.evidence.studies import Outcome, made_on, published_problem, wing_study

METHODS: dict[str, tuple[str, float]] = {
    "classical": ("classical", 0.25),
    "zhang2026 q=0.25": ("zhang2026", 0.25),
    "zhang2026 q=0.15": ("zhang2026", 0.15),
    "zhang2026 q=0.1": ("zhang2026", 0.1),
    "default": ("default", 0.25),
}
STUDIES: dict[str, Callable[[str, float, int], Outcome]] = {
    "paper_surface_2": wing_study("paper_surface_2"),
    "wing_table_2": wing_study("wing_table_2"),
    "youn_choi_2d": partial(published_problem, "youn_choi_2d"),
    "column_buckling_dubourg": partial(published_problem, "column_buckling_dubourg"),
    "highly_nonlinear_2d": partial(published_problem, "highly_nonlinear_2d"),
    "cantilever_beam": partial(published_problem, "cantilever_beam"),
    "paper_surface_3": wing_study("paper_surface_3"),
}


def collect(
    path: Path, seeds: int, studies: Sequence[str] = (), on_run: Callable[[str], None] = lambda line: None
) -> None:
    """Complete the file of runs.

    Parameters
    ----------
    path : file of JSON lines; continued where it is
    seeds : seeds 0 to seeds - 1 of every study and method
    studies : names; none: all
    on_run : told a line about every run

    Raises
    ------
    InputError
        A study is unknown, or the file holds something else.
    """
    names = list(studies or STUDIES)
    for name in names:
        if name not in STUDIES:
            raise InputError(f"study '{name}' is unknown; allowed: {', '.join(STUDIES)}")
    done = {(r["study"], r["on"], r["method"], r["seed"]) for r in read(path)}
    path.parent.mkdir(parents=True, exist_ok=True)
    for seed in range(seeds):
        for name in names:
            on = made_on(name)
            for label, (method, q) in METHODS.items():
                if (name, on, label, seed) in done:
                    continue
                row = {"study": name, "on": on, "method": label, "seed": seed, **_run(name, method, q, seed)}
                with path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(row) + "\n")
                on_run(f"{name} {label} seed {seed}: {row['reached']} to reach, stopped at {row['stopped']}")


def read(path: Path) -> list[dict[str, Any]]:
    """Read the runs of a file, the first of each; none where there is no file.

    What a kill left of a last line is dropped.

    Raises
    ------
    InputError
        A line in the middle is no run.
    """
    if not path.exists():
        return []
    content = path.read_bytes()
    whole = content.rfind(b"\n") + 1
    if whole < len(content):
        with path.open("r+b") as file:
            file.truncate(whole)
    rows: dict[tuple[str, str, str, int], dict[str, Any]] = {}
    for row in _parsed(path, content[:whole].splitlines()):
        rows.setdefault((row["study"], row["on"], row["method"], row["seed"]), row)
    return list(rows.values())


def _parsed(path: Path, lines: Iterable[bytes]) -> Iterable[dict[str, Any]]:
    for number, line in enumerate(lines, 1):
        try:
            row = json.loads(line)
            found = {key: row[key] for key in ("study", "method", "seed", "reached", "stopped", "gap")}
            yield found | {"on": row.get("on", "")}
        except (ValueError, KeyError, TypeError):
            raise InputError(f"{path}: line {number} is no run of this comparison") from None


def _run(name: str, method: str, q: float, seed: int) -> dict[str, Any]:
    try:
        return asdict(STUDIES[name](method, q, seed))
    except CwmavError:
        return asdict(Outcome(None, None, float("inf")))
