# SPDX-License-Identifier: Apache-2.0
"""Table and figure of a comparison: median and quartiles of the true evaluations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cwmav_rbdo.evidence.collect import METHODS

Row = Mapping[str, Any]


def summarise(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Quartiles of the evaluations to the optimum and to the method's own end, per study and method.

    A run that did not reach the optimum counts as slower than every one that did: a quartile among those is
    None.
    """
    found = []
    for study in dict.fromkeys(_name(r) for r in rows):
        for method in METHODS:
            runs = [r for r in rows if _name(r) == study and r["method"] == method]
            if runs:
                found.append(_summary(study, method, runs))
    return found


def table_lines(rows: Sequence[Row]) -> Iterator[str]:
    """Give the summary as the rows of a table in the documentation."""
    yield "| study | method | runs | reached | evaluations to the optimum | own end (runs) | gap there [%] |"
    yield "| --- | --- | --- | --- | --- | --- | --- |"
    for s in summarise(rows):
        gap = f"{100.0 * s['gap_median']:.2f}" if np.isfinite(s["gap_median"]) else "-"
        yield (
            f"| {s['study']} | {s['method']} | {s['runs']} | {s['reached']} | {_spread(s['to_reach'])} | "
            f"{_spread(s['to_stop'])} ({s['stopped']}) | {gap} |"
        )


def write_figure(rows: Sequence[Row], path: Path) -> None:
    """Draw median and quartiles of the evaluations to the optimum, one panel per study."""
    summaries = summarise(rows)
    studies = list(dict.fromkeys(s["study"] for s in summaries))
    figure = Figure(figsize=(9.0, 1.2 + 1.5 * len(studies)), layout="constrained")
    panels = np.atleast_1d(figure.subplots(len(studies), 1))
    for axes, study in zip(panels, studies, strict=True):
        shown = [s for s in summaries if s["study"] == study]
        for row, s in enumerate(shown):
            low, middle, high = s["to_reach"]
            if middle is None:
                axes.text(
                    0.99,
                    row,
                    "not reached by half of the runs",
                    ha="right",
                    va="center",
                    fontsize=8,
                    transform=axes.get_yaxis_transform(),
                )
                continue
            top = middle if high is None else high
            axes.plot([low, top], [row, row], "-", color="C0", lw=2)
            axes.plot(middle, row, "o", color="C0")
            if high is None:
                axes.plot(top, row, ">", color="C0")
        axes.set_yticks(range(len(shown)), [s["method"] for s in shown])
        axes.set_ylim(len(shown) - 0.5, -0.5)
        axes.set_xlim(left=0)
        axes.set_title(f"{study}, {max(s['runs'] for s in shown)} seeds", fontsize=10)
        axes.grid(axis="x", alpha=0.3)
    panels[-1].set_xlabel("true evaluations until the design is the optimum (median, quartiles) [1]")
    figure.savefig(path, dpi=120)


def _name(row: Row) -> str:
    """Name of a study, with the data it was made on where they may be replaced."""
    return f"{row['study']} ({row['on']})" if row["on"] else str(row["study"])


def _summary(study: str, method: str, runs: Sequence[Row]) -> dict[str, Any]:
    gaps = [r["gap"] for r in runs if r["gap"] is not None]
    return {
        "study": study,
        "method": method,
        "runs": len(runs),
        "reached": sum(r["reached"] is not None for r in runs),
        "stopped": sum(r["stopped"] is not None for r in runs),
        "to_reach": _quartiles([r["reached"] for r in runs]),
        "to_stop": _quartiles([r["stopped"] for r in runs]),
        "gap_median": float(np.median(gaps)) if gaps else float("nan"),
    }


def _quartiles(values: Sequence[int | None]) -> list[float | None]:
    ranked = sorted(float("inf") if v is None else float(v) for v in values)
    # The nearest rank, because between a number and "never" there is nothing to interpolate.
    found = [ranked[min(len(ranked) - 1, int(np.ceil(p * len(ranked))) - 1)] for p in (0.25, 0.5, 0.75)]
    return [None if v == float("inf") else v for v in found]


def _spread(quartiles: Sequence[float | None]) -> str:
    low, middle, high = ("-" if v is None else f"{v:g}" for v in quartiles)
    return f"{middle} [{low}, {high}]"
