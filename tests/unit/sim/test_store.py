# SPDX-License-Identifier: Apache-2.0
"""Results are kept by content and never served stale."""

import math

import pytest

from cwmav_common.errors import InputError, WorkError
from cwmav_sim import case as cases
from cwmav_sim.store import ResultStore
from support.sim_results import result_for


def test_result_comes_back_as_it_was_put(tmp_path):
    case = cases.preset("smoke").at(12.0, 20.0, 3.0)
    result = result_for(case, lift=0.123)
    store = ResultStore(tmp_path / "store")
    assert store.get(case) is None
    store.put(case, result)
    found = ResultStore(tmp_path / "store").get(case)
    assert found == result
    assert found.provenance.solver == result.provenance.solver


def test_undefined_uncertainty_survives_json(tmp_path):
    case = cases.preset("smoke")
    store = ResultStore(tmp_path)
    store.put(case, result_for(case, lift=0.1, lift_std=float("nan")))
    assert math.isnan(store.get(case).lift_std)


def test_other_settings_and_other_solvers_miss(tmp_path, monkeypatch):
    case = cases.preset("smoke")
    store = ResultStore(tmp_path)
    store.put(case, result_for(case, lift=0.1))
    assert store.get(case.at(16.0, 15.0, 3.4)) is None
    monkeypatch.setattr(cases, "solver_fingerprint", lambda: "changed")
    assert store.get(case) is None


def test_damaged_file_is_named(tmp_path):
    case = cases.preset("smoke")
    store = ResultStore(tmp_path)
    path = store.put(case, result_for(case, lift=0.1))
    path.write_text(path.read_text()[:100])
    with pytest.raises(InputError, match=path.name):
        store.get(case)
    path.write_text('{"result": {"F_hz": 16}}')
    with pytest.raises(InputError, match="is not a stored result"):
        store.get(case)


def test_unwritable_folder_is_a_failure_of_work(tmp_path):
    (tmp_path / "store").write_text("a file where a folder should be")
    with pytest.raises(WorkError, match="cannot be stored"):
        ResultStore(tmp_path / "store").put(
            cases.preset("smoke"), result_for(cases.preset("smoke"), lift=0.1)
        )


def test_nothing_unfinished_is_left_behind(tmp_path):
    case = cases.preset("smoke")
    ResultStore(tmp_path).put(case, result_for(case, lift=0.1))
    assert not list(tmp_path.rglob("*.part"))


def test_everything_is_returned_in_order(tmp_path):
    base, store = cases.preset("smoke"), ResultStore(tmp_path)
    points = [base.at(20.0, 10.0, 3.0), base.at(8.0, 40.0, 3.0), base.at(8.0, 5.0, 3.0)]
    for case in points:
        store.put(case, result_for(case, lift=0.1))
    found = [(r.flapping_frequency, r.angle_of_attack_deg) for r in store.everything()]
    assert found == [(8.0, 5.0), (8.0, 40.0), (20.0, 10.0)]


def test_results_of_another_solver_are_refused_when_gathered(tmp_path):
    case, store = cases.preset("smoke"), ResultStore(tmp_path)
    path = store.put(case, result_for(case, lift=0.1))
    made_by = result_for(case, lift=0.1).provenance.solver
    path.write_text(path.read_text().replace(made_by, "ffffffffffff"))
    with pytest.raises(InputError, match="made by solver ffffffffffff"):
        store.everything()
    with pytest.raises(InputError, match="its settings are"):
        store.everything("ffffffffffff")


def test_results_of_a_named_solver_are_gathered(tmp_path, monkeypatch):
    case, store = cases.preset("smoke"), ResultStore(tmp_path)
    made_by = result_for(case, lift=0.1).provenance.solver
    store.put(case, result_for(case, lift=0.1))
    monkeypatch.setattr(cases, "solver_fingerprint", lambda: "newer")
    with pytest.raises(InputError, match="allowed: newer"):
        store.everything()
    assert [r.mean_lift for r in store.everything(made_by)] == [0.1]


def test_result_under_changed_settings_is_refused_when_gathered(tmp_path):
    case, store = cases.preset("smoke"), ResultStore(tmp_path)
    path = store.put(case, result_for(case, lift=0.1))
    path.write_text(path.read_text().replace('"density": 1.225', '"density": 1.34'))
    with pytest.raises(InputError, match="its settings are"):
        store.everything()
