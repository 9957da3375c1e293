# SPDX-License-Identifier: Apache-2.0
"""Sweeps resume, list what failed, and refuse bad tables before any work."""

import csv
from concurrent.futures import Future
from types import SimpleNamespace

import numpy as np
import pytest

from cwmav_common.errors import CancelledError, InputError, WorkError
from cwmav_sim import case as cases
from cwmav_sim.runners import InProcess
from cwmav_sim.store import ResultStore
from cwmav_sim.sweep import cases_of, latin_hypercube, read_points, sweep, write_points, write_table
from cwmav_sim.table import read_rows
from cwmav_sim.warm import from_nearest
from support.sim_results import result_for

POINTS = [(8.0, 0.0, 2.0), (16.0, 15.0, 3.5), (24.0, 30.0, 5.0)]


@pytest.fixture
def points():
    return cases_of(cases.preset("smoke"), POINTS)


def test_second_sweep_computes_nothing(tmp_path, points):
    calls = []

    def simulate(case):
        calls.append(case)
        return result_for(case, lift=0.01 * len(calls))

    first = sweep(points, ResultStore(tmp_path), InProcess(simulate))
    second = sweep(points, ResultStore(tmp_path), InProcess(simulate))
    assert len(calls) == 3
    assert (first.computed, second.computed) == (3, 0)
    assert first.results == second.results


def test_interrupted_sweep_continues_where_it_stopped(tmp_path, points):
    def stop_at_second(case):
        if case == points[1]:
            raise CancelledError("stopped")
        return result_for(case, lift=0.1)

    with pytest.raises(CancelledError):
        sweep(points, ResultStore(tmp_path), InProcess(stop_at_second))
    rest = sweep(points, ResultStore(tmp_path), InProcess(lambda case: result_for(case, lift=0.1)))
    assert rest.computed == 2


def test_failed_case_is_listed_and_the_sweep_goes_on(tmp_path, points):
    def fail_at_second(case):
        if case == points[1]:
            raise WorkError("the flow became undefined")
        return result_for(case, lift=0.1)

    seen = []
    swept = sweep(points, ResultStore(tmp_path), InProcess(fail_at_second), lambda k, outcome: seen.append(k))
    assert [r.flapping_frequency for r in swept.results] == [8.0, 24.0]
    assert swept.failed[0].reason == "the flow became undefined"
    assert (swept.failed[0].F_hz, swept.failed[0].AoA_deg, swept.failed[0].U_m_s) == POINTS[1]
    assert seen == [0, 1, 2]


ROWS = [(16.0, 15.0, 3.5), (26.0, 50.0, 1.0), (17.0, 16.0, 3.5), (25.0, 45.0, 1.0), (17.0, 17.0, 3.4)]


@pytest.fixture
def linked():
    return from_nearest(cases_of(cases.preset("smoke"), ROWS))


def test_every_row_starts_from_the_nearest_before(linked):
    address = [case.address() for case in linked]
    assert [case.run.start_from for case in linked] == ["", address[0], address[0], address[1], address[2]]
    longer = from_nearest(cases_of(cases.preset("smoke"), [*ROWS, (4.0, 0.0, 0.0)]))
    assert longer[:5] == linked


class Backwards:
    """Three cases at a time; the one that was given last ends first."""

    workers = 3

    def __init__(self, fails=""):
        self.given, self.fails, self._open = [], fails, []

    def submit(self, case):
        future = Future()
        self.given.append(case.address())
        self._open.append((case, future))
        return future

    def end_one(self):
        case, future = self._open.pop()
        if case.address() == self.fails:
            future.set_exception(WorkError("the flow became undefined"))
        else:
            future.set_result(result_for(case, lift=0.1))


def sweep_backwards(monkeypatch, runner, linked, folder, **options):
    def wait_for_one(running, **_):
        if running:
            runner.end_one()
        return SimpleNamespace(done=[future for future in running if future.done()])

    monkeypatch.setattr("cwmav_sim.sweep.wait", wait_for_one)
    return sweep(linked, ResultStore(folder), runner, **options)


def test_a_case_waits_for_the_one_it_starts_from(tmp_path, linked, monkeypatch):
    runner = Backwards()
    swept = sweep_backwards(monkeypatch, runner, linked, tmp_path)
    assert len(swept.results) == 5
    for case in linked[1:]:
        assert runner.given.index(case.run.start_from) < runner.given.index(case.address())


def test_what_starts_from_a_failed_case_fails_too_and_says_why(tmp_path, linked, monkeypatch):
    runner = Backwards(fails=linked[1].address())
    swept = sweep_backwards(monkeypatch, runner, linked, tmp_path)
    assert [(f.F_hz, f.reason) for f in swept.failed] == [
        (26.0, "the flow became undefined"),
        (25.0, "the case it starts from failed"),
    ]
    assert linked[3].address() not in runner.given


def test_air_that_is_gone_is_computed_again_only_where_it_is_needed(tmp_path, linked, monkeypatch):
    sweep_backwards(monkeypatch, Backwards(), linked[:3], tmp_path)
    again = Backwards()
    swept = sweep_backwards(monkeypatch, again, linked, tmp_path, has_state=lambda case: case == linked[2])
    assert again.given == [linked[k].address() for k in (0, 4, 1, 3)]
    assert (swept.computed, len(swept.results)) == (4, 5)


def test_points_are_read_by_column_name(tmp_path):
    path = tmp_path / "cases.csv"
    path.write_text("F_hz,U_m_s,AoA_deg,lift_experiment_n\n12,3.5,15,0.1616\n16,0.5,-10,\n")
    assert read_points(path) == [(12.0, 15.0, 3.5), (16.0, -10.0, 0.5)]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("F_hz,U_m_s\n12,3.5\n", "column AoA_deg is missing"),
        ("F_hz,U_m_s,AoA_deg\n12,fast,15\n", "line 2: U_m_s is 'fast'"),
        ("F_hz,U_m_s,AoA_deg\n12,3.5\n", "line 2: AoA_deg"),
        ("F_hz,U_m_s,AoA_deg\n", "no operating point"),
        ("", "is missing"),
    ],
)
def test_bad_tables_are_refused_with_the_place(tmp_path, text, message):
    path = tmp_path / "cases.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_points(path)


def test_missing_table_is_named(tmp_path):
    with pytest.raises(InputError, match=r"absent\.csv"):
        read_points(tmp_path / "absent.csv")


def test_point_outside_the_design_space_is_refused_before_running():
    with pytest.raises(InputError, match="flapping_frequency"):
        cases_of(cases.preset("smoke"), [(12.0, 15.0, 3.5), (40.0, 15.0, 3.5)])


def test_written_table_holds_settings_and_solver_of_every_row(tmp_path, points):
    results = [result_for(case, lift=0.1) for case in points]
    write_table(results, tmp_path / "table.csv")
    with (tmp_path / "table.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["address"] for row in rows] == [case.address() for case in points]
    assert {row["solver"] for row in rows} == {results[0].provenance.solver}
    assert {row["preset"] for row in rows} == {"smoke"}
    read = read_rows(tmp_path / "table.csv")
    assert read.points.shape == (3, 3)
    assert read.half_model


def test_latin_hypercube_fills_every_slice_and_repeats_with_its_seed():
    first = latin_hypercube(24, np.random.default_rng(5))
    assert first == latin_hypercube(24, np.random.default_rng(5))
    assert first != latin_hypercube(24, np.random.default_rng(6))
    unit = (np.array(first) - [4.0, -10.0, 0.0]) / [26.0, 70.0, 6.0]
    for column in unit.T:
        assert len(set(np.floor(column * 24))) >= 23, "one point in each of 24 slices, to rounding"


def test_points_at_one_airspeed_survive_their_file(tmp_path):
    spread = latin_hypercube(7, np.random.default_rng(1), airspeed=3.0)
    write_points(spread, tmp_path / "points.csv")
    assert read_points(tmp_path / "points.csv") == spread
    assert {u for _, _, u in spread} == {3.0}
