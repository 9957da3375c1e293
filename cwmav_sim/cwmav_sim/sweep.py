# SPDX-License-Identifier: Apache-2.0
"""Many operating points, resumable through the result store."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import qmc

from cwmav_common.errors import CancelledError, InputError, WorkError
from cwmav_sim.case import Case
from cwmav_sim.result import LiftResult
from cwmav_sim.runners import Runner
from cwmav_sim.store import ResultStore

COLUMNS = ("F_hz", "U_m_s", "AoA_deg")


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
    runner: Runner,
    on_result: Callable[[int, LiftResult | Failure], None] | None = None,
    has_state: Callable[[Case], bool] = lambda case: True,
) -> SweepResult:
    """Run every case that the store does not hold.

    Parameters
    ----------
    cases : sequence of Case
        What to run.
    store : ResultStore
        Where results are looked up and kept; a sweep started again continues there.
    runner : Runner
        Runs cases, several at a time.
    on_result : callable, optional
        Told the number of each case and its result or failure, as soon as it is known.
    has_state : callable, optional
        Tells whether the last air of a case that the store holds is there too. A case runs after the one it
        starts from; where that one's air is missing, it is computed again.

    Returns
    -------
    SweepResult
        A case whose run fails is listed, and the sweep goes on.
    """
    outcomes: dict[int, LiftResult | Failure] = {}

    def keep(number: int, outcome: LiftResult | Failure) -> None:
        outcomes[number] = outcome
        if on_result is not None:
            on_result(number, outcome)

    stored = _stored(cases, store, has_state)
    for number, result in sorted(stored.items()):
        keep(number, result)
    waiting = [number for number in range(len(cases)) if number not in stored]
    computed = len(waiting)
    number_of = {case.address(): number for number, case in enumerate(cases)}
    running: dict[Future[LiftResult], int] = {}
    while waiting or running:
        for number in tuple(waiting):
            source = number_of.get(cases[number].run.start_from)
            if len(running) == runner.workers or (source is not None and source not in outcomes):
                continue
            waiting.remove(number)
            if source is not None and isinstance(outcomes[source], Failure):
                keep(number, _failure(cases[number], "the case it starts from failed"))
            else:
                running[runner.submit(cases[number])] = number
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            number = running.pop(future)
            keep(number, _settle(cases[number], future, store))
    ordered = [outcomes[number] for number in range(len(cases))]
    results = tuple(outcome for outcome in ordered if isinstance(outcome, LiftResult))
    failed = tuple(outcome for outcome in ordered if isinstance(outcome, Failure))
    return SweepResult(results, failed, computed)


def _settle(case: Case, future: Future[LiftResult], store: ResultStore) -> LiftResult | Failure:
    """Keep the result of a finished case, or say why there is none."""
    try:
        result = future.result()
    except CancelledError:
        raise
    except WorkError as error:
        return _failure(case, str(error))
    store.put(case, result)
    return result


def _failure(case: Case, reason: str) -> Failure:
    return Failure(case.flapping_frequency, case.airspeed, case.angle_of_attack_deg, reason)


def _stored(
    cases: Sequence[Case], store: ResultStore, has_state: Callable[[Case], bool]
) -> dict[int, LiftResult]:
    """Return what need not be computed; cases come after those they start from."""
    found: dict[int, LiftResult] = {}
    wanted: set[str] = set()  # addresses of cases whose air is needed
    for number, case in reversed(tuple(enumerate(cases))):
        result = store.get(case)
        if result is None or (case.address() in wanted and not has_state(case)):
            wanted.add(case.run.start_from)
        else:
            found[number] = result
    return found


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
