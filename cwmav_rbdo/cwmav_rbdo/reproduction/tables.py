# SPDX-License-Identifier: Apache-2.0
"""The tables of the paper as they come with the package; see ``data/SOURCES.md``."""

from __future__ import annotations

import csv
from importlib import resources
from typing import Any

NAMES = {
    "table1": "table1_dp",
    "table3": "table3_lift",
    "table5": "table5_two_variables",
    "table6": "table6_three_variables",
    "table7": "table7_classical_vs_accelerated",
}


def paper_table(name: str) -> list[dict[str, Any]]:
    """Rows of a table; numbers as float, empty cells as None."""
    text = (resources.files("cwmav_rbdo.data") / f"{name}.csv").read_text(encoding="utf-8")
    return [{key: _value(cell) for key, cell in row.items()} for row in csv.DictReader(text.splitlines())]


def _value(cell: str) -> Any:
    if cell == "":
        return None
    try:
        return float(cell)
    except ValueError:
        return cell
