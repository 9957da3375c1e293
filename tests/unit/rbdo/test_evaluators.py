# SPDX-License-Identifier: Apache-2.0
import math
from dataclasses import replace

import numpy as np
import pytest

from cwmav_common.errors import InputError, WorkError
from cwmav_rbdo import noise
from cwmav_rbdo.evaluators import LiveEvaluator, TableEvaluator, power_model, wing_evaluator
from cwmav_rbdo.wing_problem import Source
from cwmav_sim.table import LiftTable, TableRows
from support.ratio_bowl import small_problem

POINT = np.array([10.0, math.radians(20.0), 3.0])


@pytest.fixture
def table(monkeypatch):
    """Put a lift table of 30 made-up runs in place of the bundled one."""
    rng = np.random.default_rng(0)
    points = rng.uniform([5, -0.1, 1], [28, 0.9, 5], (30, 3))
    lift = 0.02 * points[:, 2] ** 2 * np.sin(points[:, 1] + 0.07)
    rows = TableRows(points, lift, np.full(30, 1e-4), "coarse", 0.008, True, "0.1.0", "test")
    made = LiftTable(rows)
    monkeypatch.setattr(LiftTable, "bundled", classmethod(lambda cls: made))
    return made


def test_table_evaluator_joins_lift_and_power_with_their_sources(table):
    power = power_model(small_problem())
    answer = TableEvaluator(power).submit(POINT).result()
    expected_lift, expected_power = table.lift(*POINT), power.predict(*POINT)
    assert (answer.lift, answer.lift_std) == (expected_lift.lift, expected_lift.lift_std)
    assert (answer.power, answer.power_std) == (expected_power.power, expected_power.power_std)
    assert "30 SPH runs at 8 mm" in answer.lift_source
    assert "outside" not in answer.lift_source
    assert "synthetic" in answer.power_source
    assert answer.defect() == ""


def test_point_outside_the_runs_is_answered_and_marked(table):
    answer = TableEvaluator(power_model(small_problem())).submit(np.array([29.5, 1.0, 5.9])).result()
    assert "outside of the range of the runs" in answer.lift_source


def test_evaluator_follows_the_problem(table):
    problem = small_problem()
    assert isinstance(wing_evaluator(replace(problem, evaluate="table")), TableEvaluator)
    with pytest.raises(InputError, match="evaluate: ros needs the nodes; allowed without them: local, table"):
        wing_evaluator(problem)
    with pytest.raises(InputError, match="source.fidelity is 'finest'; allowed: table, smoke, coarse"):
        wing_evaluator(replace(problem, evaluate="local", source=Source(fidelity="finest")))


def test_live_run_that_is_refused_in_its_process_fails_with_the_reason():
    evaluator = LiveEvaluator(power_model(small_problem()), "smoke")
    try:
        with pytest.raises(InputError, match="99"):
            evaluator.submit(np.array([99.0, 0.2, 3.0])).result(timeout=120)
    finally:
        evaluator.close()


REPORT = {
    "flapping_frequency_hz": {
        "mean": 12.0,
        "std": 0.15,
        "std_low": 0.14,
        "std_high": 0.16,
        "distribution": "normal",
    },
    "angle_of_attack_deg": {
        "mean": 15.0,
        "std": 0.46,
        "std_low": None,
        "std_high": None,
        "distribution": "laplace",
    },
    "forward_velocity_m_s": {
        "mean": 3.5,
        "std": 0.05,
        "std_low": 0.04,
        "std_high": 0.06,
        "distribution": "normal",
    },
}


def test_noise_is_taken_from_the_rig_report_in_the_units_of_problem_files():
    found = noise.from_report(REPORT, "a recording")
    assert [found.std(name) for name in ("F", "AoA", "U")] == [0.15, 0.46, 0.05]
    assert found.scatter["AoA"].distribution == "laplace"
    assert math.isnan(found.scatter["AoA"].low)
    restored = noise.from_json(found.to_json())
    assert restored.scatter["F"] == found.scatter["F"]
    assert math.isnan(restored.scatter["AoA"].low)


def test_scatter_that_was_not_measured_is_said_with_the_way_out():
    missing = REPORT | {"angle_of_attack_deg": {"mean": 15.0, "std": None}}
    with pytest.raises(WorkError, match="a recording: no scatter of angle_of_attack_deg"):
        noise.from_report(missing, "a recording")


def test_given_noise_needs_no_recording_and_measured_noise_does(tmp_path, monkeypatch):
    assert noise.obtain(small_problem()).std("AoA") == 0.462
    asked = small_problem(noise=None, source=Source(scatter_recording=str(tmp_path / "absent.mcap")))
    with pytest.raises(InputError, match="absent.mcap"):
        noise.obtain(asked)
    with pytest.raises(InputError, match="the problem file says 'measured'"):
        noise.given(asked)
