# SPDX-License-Identifier: Apache-2.0
"""Many operating points, one after the other, resumable through the result store."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import qmc

from cwmav_common.errors import CancelledError, InputError, WorkError
from cwmav_sim.case import Case
from cwmav_sim.result import LiftResult
from cwmav_sim.store import ResultStore

COLUMNS = ("F_hz", "U_m_s", "AoA_deg")

Simulate = Callable[[Case], LiftResult]


@dataclass(frozen=True)
class Failure:
    """A case that gave no result, and why."""

    F_hz: float
    U_m_s: float
    AoA_deg: float
    reason: str


@dataclass(frozen=True)
class SweepResult:
    """Results in the order of the points, and the points that failed."""

    results: tuple[LiftResult, ...]
    failed: tuple[Failure, ...]
    computed: int


def read_points(path: str | Path) -> list[tuple[float, float, float]]:
    """Read operating points from a CSV file with columns F_hz, U_m_s, AoA_deg.

    Returns
    -------
    list of (frequency [Hz], angle of attack [deg], airspeed [m/s])

    Raises
    ------
    InputError
        Names the file and line of what is missing or is no number. Further columns are ignored.
    """
    try:
        with Path(path).open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            missing = [name for name in COLUMNS if name not in (reader.fieldnames or [])]
            if missing:
                raise InputError(
                    f"{path}: column {', '.join(missing)} is missing; needed: {', '.join(COLUMNS)}"
                )
            points = [_point(row, f"{path}, line {reader.line_num}") for row in reader]
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error})") from None
    if not points:
        raise InputError(f"{path}: holds no operating point")
    return points


def _point(row: dict[str, str], where: str) -> tuple[float, float, float]:
    values = {}
    for name in COLUMNS:
        try:
            values[name] = float(row[name])
        except (TypeError, ValueError):
            raise InputError(f"{where}: {name} is '{row[name]}'; allowed: a number") from None
    return values["F_hz"], values["AoA_deg"], values["U_m_s"]


def latin_hypercube(
    count: int, rng: np.random.Generator, airspeed: float | None = None
) -> list[tuple[float, float, float]]:
    """Spread operating points over the design space, 4..30 Hz, -10..60 deg, 0..6 m/s.

    Parameters
    ----------
    count : int
        Number of points.
    rng : numpy.random.Generator
        Source of randomness.
    airspeed : float, optional
        Keep all points at this airspeed [m/s] instead.

    Returns
    -------
    list of (frequency [Hz], angle of attack [deg], airspeed [m/s])
        Rounded to three digits after the point, as they are written.
    """
    low, high = (4.0, -10.0, 0.0), (30.0, 60.0, 6.0)
    dimensions = 3 if airspeed is None else 2
    unit = qmc.LatinHypercube(d=dimensions, optimization="random-cd", rng=rng).random(count)
    points = qmc.scale(unit, low[:dimensions], high[:dimensions]).round(3)
    return [(float(p[0]), float(p[1]), float(p[2]) if airspeed is None else airspeed) for p in points]


def write_points(points: Iterable[tuple[float, float, float]], path: str | Path) -> None:
    """Write operating points as :func:`read_points` reads them."""
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows((f"{f:g}", f"{u:g}", f"{a:g}") for f, a, u in points)


def cases_of(base: Case, points: Iterable[tuple[float, float, float]]) -> list[Case]:
    """Place a case at every point; a point outside the limits is refused before anything runs."""
    return [base.at(*point) for point in points]


def sweep(
    cases: Sequence[Case],
    store: ResultStore,
    simulate: Simulate,
    on_result: Callable[[int, LiftResult | Failure], None] | None = None,
) -> SweepResult:
    """Run every case that the store does not hold.

    Parameters
    ----------
    cases : sequence of Case
        What to run.
    store : ResultStore
        Where results are looked up and kept; a sweep started again continues there.
    simulate : callable
        Runs one case.
    on_result : callable, optional
        Told after each case its number and its result or failure.

    Returns
    -------
    SweepResult
        A case whose run fails is listed, and the sweep goes on.
    """
    results: list[LiftResult] = []
    failed: list[Failure] = []
    computed = 0
    for number, case in enumerate(cases):
        outcome: LiftResult | Failure | None = store.get(case)
        if outcome is None:
            computed += 1
            outcome = _run(case, store, simulate)
        if isinstance(outcome, LiftResult):
            results.append(outcome)
        else:
            failed.append(outcome)
        if on_result is not None:
            on_result(number, outcome)
    return SweepResult(tuple(results), tuple(failed), computed)


def _run(case: Case, store: ResultStore, simulate: Simulate) -> LiftResult | Failure:
    try:
        result = simulate(case)
    except CancelledError:
        raise
    except WorkError as error:
        return Failure(case.flapping_frequency, case.airspeed, case.angle_of_attack_deg, str(error))
    store.put(case, result)
    return result


_TABLE = (
    "F_hz",
    "AoA_deg",
    "U_m_s",
    "mean_lift_n",
    "lift_std_n",
    "mean_drag_n",
    "drag_std_n",
    "mean_power_w",
    "cycles",
    "periodic",
    "preset",
    "dp_m",
    "half_model",
    "particles",
    "steps",
    "wall_s",
    "device",
    "address",
)


def write_table(results: Iterable[LiftResult], path: str | Path) -> None:
    """Write results as CSV, one row each with its settings' address, version and solver fingerprint."""
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*_TABLE, "version", "solver", "date"])
        for result in results:
            content = result.to_json()
            origin = result.provenance
            row = [_cell(content[name]) for name in _TABLE]
            writer.writerow([*row, origin.version, origin.solver, origin.date])


def _cell(value: object) -> str:
    return f"{value:.8g}" if isinstance(value, float) else str(value)
