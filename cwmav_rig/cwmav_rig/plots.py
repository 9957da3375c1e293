# SPDX-License-Identifier: Apache-2.0
"""Pictures and tables of one analysed recording: spectra, densities, cycles, phase averages, correlations."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cwmav_common.errors import InputError
from cwmav_rig.analysis import Study
from cwmav_rig.blocks import Block, Series
from cwmav_rig.loads import to_wind_axes
from cwmav_rig.phase_average import PhaseAverage, phase_average
from cwmav_rig.spectra import PowerSpectrum, power_spectrum, probability_density

Array = NDArray[np.float64]

UNITS = {"F": "Hz", "AoA": "deg", "U": "m/s", "lift": "N", "drag": "N", "power": "W"}
HIGHEST = 250.0  # Hz, shown of a spectrum
DPI = 110


def write_all(found: Study, folder: Path) -> list[Path]:
    """Write every picture and table of a study into `folder`.

    Raises
    ------
    InputError
        The folder cannot be written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror or error})") from None
    averages, spectra = phase_averages(found), dict(_spectra(found))
    written = [folder / "report.json"]
    written[0].write_text(json.dumps(found.report.to_json(), indent=1) + "\n", encoding="utf-8")
    for name, figure in (
        ("spectra", _draw_spectra(found, spectra)),
        ("densities", _draw_densities(found)),
        ("cycles", _draw_cycles(found)),
        ("phase_average", _draw_averages(averages)),
        ("correlation", _draw_correlation(found)),
    ):
        if figure is not None:
            path = folder / f"{name}.png"
            figure.savefig(path, dpi=DPI)
            written.append(path)
    for name, rows in (
        ("cycles", _cycle_rows(found)),
        ("phase_average", _average_rows(averages)),
        ("spectra", _spectrum_rows(spectra)),
        ("budget", _budget_rows(found)),
    ):
        path = folder / f"{name}.csv"
        with path.open("w", newline="", encoding="utf-8") as stream:
            csv.writer(stream).writerows(rows)
        written.append(path)
    return written


def phase_averages(found: Study) -> dict[str, tuple[PhaseAverage, str]]:
    """Average the force along lift and drag, the power and the angle over the cycle, with their units.

    The force is that on the sensor: it holds the inertia of the wings and the ringing of the mount, which
    have no mean over a cycle.
    """
    averages = {}
    force = found.data.force
    if force is not None and found.loads.lift is not None:
        lift, drag = _wind_forces(found, force)
        averages["force normal to the wind"] = (phase_average(force, found.cycles, values=lift), "N")
        averages["force along the wind"] = (phase_average(force, found.cycles, values=drag), "N")
    if found.data.power is not None:
        averages["power"] = (phase_average(found.data.power, found.cycles, "power"), "W")
    if found.data.angle is not None:
        degrees = np.degrees(found.data.angle.values)
        averages["angle of attack"] = (phase_average(found.data.angle, found.cycles, values=degrees), "deg")
    return averages


def _wind_forces(found: Study, force: Block) -> tuple[Array, Array]:
    role, values = found.topic_map.force, force.values[:, :3]
    if found.loads.zero is not None:
        values = values - found.loads.zero.at(force.time)[:, :3]
    x, z = (
        role.gain * (-1.0 if axis.startswith("-") else 1.0) * values[:, "xyz".index(axis[-1])]
        for axis in (role.axis_thrust, role.axis_lift)
    )
    return to_wind_axes(x, z, found.loads.pitch)


def _spectra(found: Study) -> Iterator[tuple[str, tuple[PowerSpectrum, str]]]:
    streams: Sequence[tuple[str, Block | Series | None, str, str, float]] = (
        ("fx", found.data.force, "fx", "N", 1.0),
        ("fz", found.data.force, "fz", "N", 1.0),
        ("power", found.data.power, "power", "W", 1.0),
        ("AoA", found.data.angle, "", "deg", float(np.degrees(1.0))),
        ("U", found.data.wind, "", "m/s", 1.0),
    )
    for name, stream, column, unit, factor in streams:
        spectrum = None if stream is None else power_spectrum(stream, column, factor)
        if spectrum is not None:
            yield name, (spectrum, unit)


def _panels(count: int, title: str, height: float = 2.2) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(9.0, 0.8 + height * count), layout="constrained")
    figure.suptitle(title, fontsize=10)
    return figure, [figure.add_subplot(count, 1, k + 1) for k in range(count)]


def _title(found: Study, what: str) -> str:
    kind = "synthetic, " if found.report.synthetic else ""
    return f"{what}: {Path(found.report.source).name} ({kind}{found.report.cycles} cycles)"


def _draw_spectra(found: Study, spectra: dict[str, tuple[PowerSpectrum, str]]) -> Figure | None:
    if not spectra:
        return None
    figure, axes = _panels(len(spectra), _title(found, "Power spectral density"))
    flapping = found.report.flapping_frequency
    for ax, (name, (spectrum, unit)) in zip(axes, spectra.items(), strict=True):
        shown = (spectrum.frequency > 0) & (spectrum.frequency <= HIGHEST)
        ax.semilogy(spectrum.frequency[shown], spectrum.density[shown], lw=0.8)
        if flapping is not None:
            for order in range(1, 5):
                ax.axvline(order * flapping.mean, color="0.7", lw=0.6, zorder=0)
        ax.set_ylabel(f"{name} [({unit})²/Hz]")
    resonance = found.report.mount_resonance
    ringing = f"; the mount rings at {resonance:.0f} Hz" if resonance is not None else ""
    axes[0].set_title(f"grey: once to four times the flapping frequency{ringing}", fontsize=8)
    axes[-1].set_xlabel("frequency [Hz]")
    return figure


def _draw_densities(found: Study) -> Figure | None:
    rows = [(name, values) for name, values in _records(found) if probability_density(values) is not None]
    if not rows:
        return None
    figure, axes = _panels(len(rows), _title(found, "Probability density"))
    report = found.report
    spreads = {
        "F": report.flapping_frequency,
        "AoA": report.angle_of_attack,
        "U": report.airspeed,
        "lift": report.lift,
        "drag": report.drag,
        "power": report.power,
    }
    for ax, (name, values) in zip(axes, rows, strict=True):
        density, spread = probability_density(values), spreads[name]
        if density is None:
            continue
        ax.stairs(density.histogram, density.edges, fill=True, alpha=0.3)
        ax.plot(density.value, density.kernel, color="0.4", lw=0.8, label="kernel estimate")
        ax.plot(density.value, density.fitted["normal"], "--", lw=1.0, label="normal")
        if spread is not None and spread.fits:
            best = spread.fits[0]
            if best.name != "normal":
                ax.plot(density.value, density.fitted[best.name], lw=1.2, label=best.name)
            factor = float(np.degrees(1.0)) if name == "AoA" else 1.0
            ax.set_title(
                f"s = {spread.std * factor:.4g} {UNITS[name]} [{spread.std_low * factor:.4g},"
                f" {spread.std_high * factor:.4g}], best: {best.name} (KS distance {best.statistic:.3f},"
                f" p {best.p_value:.2f})",
                fontsize=8,
            )
        ax.set_xlabel(f"{name} [{UNITS[name]}]")
        ax.set_ylabel(f"density [1/({UNITS[name]})]")
        ax.legend(fontsize=7)
    return figure


def _records(found: Study) -> Iterator[tuple[str, Array]]:
    """Give what the spread of each quantity is made of: cycle values, or samples of angle and wind."""
    for name, values in found.per_cycle.items():
        if name == "AoA" and found.data.angle is not None:
            yield name, np.degrees(found.data.angle.values)
        elif name == "U" and found.data.wind is not None:
            yield name, found.data.wind.values
        else:
            yield name, values


def _draw_cycles(found: Study) -> Figure:
    figure, axes = _panels(len(found.per_cycle), _title(found, "Cycle by cycle"), 1.6)
    bounds, bad = found.cycles.bounds, ~found.cycles.good
    middle = 0.5 * (bounds[1:] + bounds[:-1])
    for ax, (name, values) in zip(axes, found.per_cycle.items(), strict=True):
        ax.plot(middle, values, ".", ms=2.5)
        for begin, end in zip(bounds[:-1][bad], bounds[1:][bad], strict=True):
            ax.axvspan(begin, end, color="tab:red", alpha=0.4, lw=0)
        ax.set_ylabel(f"{name} [{UNITS[name]}]")
    reasons = ", ".join(f"{count} {reason}" for reason, count in found.cycles.rejected.items())
    axes[0].set_title(f"red: left out ({reasons})" if reasons else "no cycle left out", fontsize=8)
    axes[-1].set_xlabel("time [s]")
    return figure


def _draw_averages(averages: dict[str, tuple[PhaseAverage, str]]) -> Figure | None:
    if not averages:
        return None
    figure, axes = _panels(len(averages), "Phase average with the band that holds 95 % of the samples")
    for ax, (name, (average, unit)) in zip(axes, averages.items(), strict=True):
        ax.fill_between(average.phase, average.low, average.high, alpha=0.25, lw=0)
        ax.plot(average.phase, average.mean, lw=1.2)
        ax.set_ylabel(f"{name} [{unit}]", fontsize=8)
    axes[-1].set_xlabel("phase of the flapping cycle [turns]")
    return figure


def _draw_correlation(found: Study) -> Figure | None:
    matrix = found.report.correlations
    if matrix is None:
        return None
    figure = Figure(figsize=(6.0, 5.0), layout="constrained")
    ax = figure.add_subplot()
    image = ax.imshow(matrix.matrix, vmin=-1.0, vmax=1.0, cmap="RdBu")
    k = len(matrix.names)
    ax.set_xticks(range(k), matrix.names)
    ax.set_yticks(range(k), matrix.names)
    for i in range(k):
        for j in range(k):
            text = "1" if i == j else f"{matrix.matrix[i, j]:.2f}\n± {matrix.std[i, j]:.2f}"
            ax.text(j, i, text, ha="center", va="center", fontsize=8)
    ax.set_title(_title(found, "Correlation of the cycle values"), fontsize=9)
    figure.colorbar(image, label="correlation coefficient [-]")
    return figure


Rows = Iterator[Sequence[Any]]


def _cycle_rows(found: Study) -> Rows:
    yield ["begin_s", "end_s", "used", *(f"{name}_{UNITS[name]}" for name in found.per_cycle)]
    columns = [found.cycles.bounds[:-1], found.cycles.bounds[1:], found.cycles.good.astype(int)]
    yield from zip(*columns, *found.per_cycle.values(), strict=True)


def _average_rows(averages: dict[str, tuple[PhaseAverage, str]]) -> Rows:
    yield ["quantity", "unit", "phase_turns", "mean", "mean_std", "std", "low_2.5%", "high_97.5%"]
    for name, (a, unit) in averages.items():
        for row in zip(a.phase, a.mean, a.mean_std, a.std, a.low, a.high, strict=True):
            yield [name, unit, *row]


def _spectrum_rows(spectra: dict[str, tuple[PowerSpectrum, str]]) -> Rows:
    yield ["quantity", "unit", "frequency_hz", "density"]
    for name, (spectrum, unit) in spectra.items():
        for row in zip(spectrum.frequency, spectrum.density, strict=True):
            yield [name, f"({unit})^2/Hz", *row]


def _budget_rows(found: Study) -> Rows:
    yield ["quantity", "source", "type", "std", "unit", "sensitivity", "contribution", "degrees_of_freedom"]
    for name, budget in found.report.budgets.items():
        for row in budget.rows:
            values = (row.name, row.kind, row.value, row.unit, row.sensitivity, row.contribution, row.dof)
            yield [name, *values]
        yield [name, "combined", "", "", budget.unit, "", budget.combined, budget.dof]
