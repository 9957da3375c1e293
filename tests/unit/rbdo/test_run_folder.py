# SPDX-License-Identifier: Apache-2.0
import csv
import json
import re
from datetime import datetime

import pytest
import yaml

from cwmav_common.errors import InputError
from cwmav_common.interfaces import deserialise
from cwmav_common.mcap_reader import open_recording
from cwmav_rbdo.problem import parse_problem
from cwmav_rbdo.run_folder import RunFolder
from cwmav_rbdo.study import run_study
from support.ratio_bowl import NOISE, BowlEvaluator, small_problem


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = RunFolder.create(tmp_path_factory.mktemp("runs"), "two variables")
    result = run_study(
        small_problem(max_iterations=2), BowlEvaluator(), seed=5, run_folder=folder, noise=NOISE
    )
    return folder, result


def test_folder_holds_exactly_what_the_contract_lists(finished):
    folder, _ = finished
    assert {p.name for p in folder.path.iterdir()} == {
        "config.yaml", "result.json", "iterations.csv", "report.html", "run.mcap", "journal",
    }  # fmt: skip


def test_name_is_time_and_problem_and_never_taken_twice(tmp_path):
    now = datetime(2026, 11, 22, 10, 15, 3)
    first, second = (RunFolder.create(tmp_path, "a/b c", now) for _ in range(2))
    assert first.path.name == "2026-11-22T10-15-03-a_b_c"
    assert second.path.name == "2026-11-22T10-15-03-a_b_c-2"


def test_result_has_the_keys_of_the_contract(finished):
    folder, result = finished
    content = json.loads(folder.result.read_text())
    for key in (
        "design",
        "objective",
        "constraints",
        "iterations",
        "true_evaluations",
        "converged",
        "history",
    ):
        assert key in content
    assert set(content["design"]) == {"F", "AoA"}
    for key in ("name", "reliability", "reliability_std"):
        assert key in content["constraints"][0]
    assert content["objective"] == result.objective
    assert len(content["history"]) == content["iterations"] + 1


def test_config_reads_back_as_the_same_problem(finished):
    folder, _ = finished
    config = yaml.safe_load(folder.config.read_text())
    # All settings are resolved there, also the size of a round that the file leaves open.
    assert parse_problem(config["problem"], "config.yaml") == small_problem(max_iterations=2, batch_size=1)
    assert config["seed"] == 5
    assert config["noise"]["scatter"]["AoA"]["std"] == 0.462


def test_iterations_table_has_the_columns_of_tables_5_and_6(finished):
    folder, result = finished
    rows = list(csv.DictReader(folder.iterations.read_text().splitlines()))
    for column in ("iteration", "F_hz", "AoA_deg", "lift_to_power_n_w", "mse", "max_mse", "error_percent",
                   "reliability", "solves"):  # fmt: skip
        assert column in rows[0]
    assert float(rows[-1]["F_hz"]) == result.design["F"]
    assert int(rows[-1]["solves"]) == result.true_evaluations


def test_report_stands_alone_and_shows_numbers_units_and_decisions(finished):
    folder, result = finished
    html = folder.report.read_text()
    assert not re.search(r'(?:src|href)="(?!#)', html.replace('xlink:href="#', 'x="'))
    assert html.count("<svg") == 3
    assert f"F = {result.design['F']:.4f} Hz" in html
    assert "flapping frequency F [Hz]" not in result.message
    for text in ("reliability", "Eq. 20", "window width by rule", "criteria.c1"):
        assert text in html


def test_recording_holds_one_message_per_iteration_in_si(finished):
    folder, result = finished
    with open_recording(folder.recording) as recording:
        messages = [deserialise(m.data, m.type_name) for m in recording.messages()]
    assert [m.iteration for m in messages] == list(range(result.iterations + 1))
    assert messages[-1].design.flapping_frequency == result.design["F"]
    assert messages[-1].design.angle_of_attack == pytest.approx(result.design["AoA"] * 0.017453292519943295)
    assert messages[-1].design.forward_velocity == 3.0


def test_newest_unfinished_run_of_a_problem_is_found(tmp_path, finished):
    problem = small_problem(max_iterations=1)
    names = []
    for second in (1, 2):
        folder = RunFolder.create(tmp_path, problem.id, datetime(2026, 1, 1, 0, 0, second))
        with pytest.raises(KeyboardInterrupt):
            run_study(problem, BowlEvaluator(stop_after=3), run_folder=folder, noise=NOISE)
        names.append(folder.path)
    assert RunFolder.unfinished(tmp_path, problem.id).path == names[1]
    with pytest.raises(InputError, match="no unfinished run of 'other'"):
        RunFolder.unfinished(tmp_path, "other")
    with pytest.raises(InputError, match="no unfinished run"):
        RunFolder.unfinished(finished[0].path.parent, problem.id)


def test_folder_without_settings_is_no_run_folder(tmp_path):
    with pytest.raises(InputError, match="is no run folder"):
        RunFolder.open(tmp_path)
