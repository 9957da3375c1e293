# SPDX-License-Identifier: Apache-2.0
"""Phase averages: what a flapping cycle looks like, and how much cycles differ."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cwmav_sim.gauges import History, phase_bins
from cwmav_sim.wing.sheet import FloatArray


@dataclass(frozen=True)
class PhaseAverage:
    """One quantity over the parts of a cycle.

    Attributes
    ----------
    name, unit : str
        What it is.
    mean, std : ndarray, shape (bins,)
        Mean over the cycles kept, and its standard uncertainty from the scatter between them; NaN for a
        single cycle.
    """

    name: str
    unit: str
    mean: FloatArray
    std: FloatArray


def phase_averages(history: History, frequency: float, discard: int) -> tuple[PhaseAverage, ...]:
    """Average the loads of the vehicle over the cycles after the first ``discard``, part by part.

    Parameters
    ----------
    history : History
        Loads against time.
    frequency : float
        Flapping frequency F [Hz].
    discard : int
        Leading cycles left out.
    """
    parts = {name: history.part(getattr(history, name)) for name in ("pressure", "viscous", "inertial")}
    signals = [("lift", "N", history.lift()), ("drag", "N", history.drag())]
    for name, force in parts.items():
        signals += [(f"{name}_lift", "N", force[:, 2]), (f"{name}_drag", "N", force[:, 0])]
    signals += [
        ("pitch_moment", "N m", history.pitch_moment()),
        ("power", "W", history.total_power()),
    ]
    return tuple(
        _average(name, unit, signal, history.time, frequency, discard) for name, unit, signal in signals
    )


def _average(
    name: str, unit: str, signal: FloatArray, time: FloatArray, frequency: float, discard: int
) -> PhaseAverage:
    kept = phase_bins(time, signal, frequency)[discard:]
    if len(kept) < 2:
        return PhaseAverage(name, unit, kept.mean(axis=0), np.full(kept.shape[1], np.nan))
    return PhaseAverage(name, unit, kept.mean(axis=0), kept.std(axis=0, ddof=1) / np.sqrt(len(kept)))


def write_phases(averages: tuple[PhaseAverage, ...], path: Path) -> None:
    """Write phase averages as CSV: middle of each part of the cycle, then means and uncertainties."""
    bins = len(averages[0].mean)
    columns, data = ["phase"], [(np.arange(bins) + 0.5) / bins]
    for average in averages:
        unit = average.unit.lower().replace(" ", "_")
        columns += [f"{average.name}_{unit}", f"{average.name}_std_{unit}"]
        data += [average.mean, average.std]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows([f"{value:.8g}" for value in row] for row in np.column_stack(data))


def draw_phases(averages: tuple[PhaseAverage, ...], title: str, path: Path) -> None:
    """Draw lift with its parts, drag, and power over the cycle, with bands of one standard uncertainty."""
    figure = Figure(figsize=(11.0, 4.0), layout="constrained")
    lift, drag, power = figure.subplots(1, 3)
    by_name = {average.name: average for average in averages}
    for axes, name in ((lift, "lift"), (drag, "drag")):
        for part, colour in ((f"inertial_{name}", "0.6"), (f"viscous_{name}", "C1"), (name, "C0")):
            _line(axes, by_name[part], part.replace(f"_{name}", ""), colour)
        axes.set(xlabel="phase after the clap [cycle]", ylabel=f"{name} [N]")
        axes.legend(fontsize="small")
    _line(power, by_name["power"], "given to the air", "C3")
    power.set(xlabel="phase after the clap [cycle]", ylabel="power [W]")
    power.legend(fontsize="small")
    figure.suptitle(title, fontsize="small")
    figure.savefig(path, dpi=120)


def _line(axes: Axes, average: PhaseAverage, label: str, colour: str) -> None:
    phase = (np.arange(len(average.mean)) + 0.5) / len(average.mean)
    axes.plot(phase, average.mean, color=colour, linewidth=1.3, label=label)
    low, high = average.mean - average.std, average.mean + average.std
    axes.fill_between(phase, low, high, color=colour, alpha=0.25, linewidth=0)
