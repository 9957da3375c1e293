# SPDX-License-Identifier: Apache-2.0
import json
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

from cwmav_rbdo.problem import bundled_problems

COLUMN = {
    "id": "column",
    "kind": "rbdo",
    "design": [
        {"name": "b", "lo": 100, "hi": 350, "start": 300},
        {"name": "h", "lo": 100, "hi": 350, "start": 300},
    ],
    "random": [
        {"name": "k", "dist": "lognormal", "mean": 0.6, "cov": 0.1},
        {"name": "E", "dist": "lognormal", "mean": 10000, "cov": 0.05},
        {"name": "L", "dist": "lognormal", "mean": 3000, "cov": 0.01},
    ],
    "let": [["I", "b*h**3/12"]],
    "objective": "b*h",
    "constraints": ["k*pi**2*E*I/L**2 - 1.4622e6"],
    "deterministic_constraints": ["b-h"],
    "pf_target": 0.05,
    "max_true_evaluations": 60,
}
PF = {
    "id": "tail",
    "kind": "reliability",
    "random": [{"name": "a", "mean": 3, "std": 1}],
    "constraints": ["a"],
}


def program(*arguments, cwd):
    return subprocess.run(
        [sys.executable, "-m", "cwmav_rbdo.cli", *map(str, arguments)],
        cwd=cwd, capture_output=True, text=True, timeout=280, check=False,
    )  # fmt: skip


def write(folder, content, name="problem.yaml"):
    path = folder / name
    path.write_text(yaml.safe_dump(content))
    return path


def test_run_prints_one_json_object_with_the_keys_of_the_contract_and_leaves_a_run_folder(tmp_path):
    done = program("run", write(tmp_path, COLUMN), "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    for key in (
        "design",
        "objective",
        "constraints",
        "iterations",
        "true_evaluations",
        "converged",
        "history",
    ):
        assert key in result
    assert result["objective"] == pytest.approx(56859.6, rel=0.005)  # analytic
    assert result["design"]["b"] == pytest.approx(238.45, rel=0.005)
    assert set(result["constraints"][0]) >= {"name", "reliability", "reliability_std"}
    folder = Path(result["run_folder"])
    assert {"config.yaml", "result.json", "iterations.csv", "journal"} <= {
        p.name for p in (tmp_path / folder).iterdir()
    }
    assert "%|" not in done.stderr  # no progress bar in a pipe


def test_reliability_gives_only_the_failure_probability(tmp_path):
    done = program("reliability", write(tmp_path, PF), "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert set(result) >= {"pf", "pf_std", "beta", "true_evaluations", "method"}
    assert result["beta"] == pytest.approx(3.0, abs=0.03)
    assert not (tmp_path / "runs").exists()


WING = {
    "id": "wing",
    "kind": "lift_to_power",
    "design": [{"name": "F", "lo": 4, "hi": 30}, {"name": "AoA", "lo": -10, "hi": 60}],
    "fixed": {"U": 3.0},
    "noise": {"F": 0.153, "AoA": 0.462, "U": 0.05},
    "require": {"lift_to_power": 0.05},
    "method": "zhang2026",
    "evaluate": "table",
    "max_iterations": 2,
    "swarm": {"particles": 100, "iterations": 60, "patience": 15},
}


def test_wing_study_on_the_bundled_table_survives_a_kill(tmp_path):
    path = write(tmp_path, WING)
    whole = program("run", path, "--seed", "3", "--runs", "whole", "--json", cwd=tmp_path)
    assert whole.returncode == 0, whole.stderr
    expected = json.loads(whole.stdout)
    assert set(expected["design"]) == {"F", "AoA"}
    assert "lift table" in (tmp_path / expected["run_folder"] / "report.html").read_text()
    victim = subprocess.Popen(
        [sys.executable, "-m", "cwmav_rbdo.cli", "run", str(path), "--seed", "3", "--runs", "killed"],
        cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    deadline = time.monotonic() + 240
    while time.monotonic() < deadline:
        journals = list((tmp_path / "killed").glob("*/journal/journal.jsonl"))
        if journals and journals[0].read_bytes().count(b'"answer"') >= 3:
            break
        time.sleep(0.02)
    victim.kill()
    victim.wait()
    resumed = program("run", path, "--resume", "--runs", "killed", "--json", cwd=tmp_path)
    assert resumed.returncode == 0, resumed.stderr
    result = json.loads(resumed.stdout)
    assert {k: v for k, v in result.items() if k != "run_folder"} == {
        k: v for k, v in expected.items() if k != "run_folder"
    }
    entries = [json.loads(line) for line in journals[0].read_text().splitlines()]
    asked = [entry["id"] for entry in entries if entry["kind"] == "request"]
    answered = [entry["id"] for entry in entries if entry["kind"] == "answer"]
    assert sorted(asked) == sorted(answered) == list(range(expected["true_evaluations"]))


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["run", "absent.yaml"], "absent.yaml: no such file; bundled problems"),
        (["run", "wrong.yaml"], "wrong.yaml: unknown key 'colour'"),
        (["run", "broken.yaml"], "broken.yaml: is not valid YAML"),
        (["run", "pf.yaml", "--evaluate", "table"], "allowed for a wing study"),
        (["run", "two_variables.yaml", "--evaluate", "magic"], "--evaluate magic: allowed"),
        (["run", "pf.yaml", "--resume"], "no unfinished run of 'tail' to resume"),
        (["reliability", "two_variables.yaml"], "kind is 'lift_to_power'; allowed here: reliability"),
        (["reproduce", "table2"], "table 'table2' is unknown"),
        (["reproduce", "table1"], "give --cases"),
        (["run", "pf.yaml", "--seed", "-1"], "greater than or equal to 0"),
    ],
)
def test_bad_usage_and_bad_input_end_with_status_2_one_message_and_no_traceback(tmp_path, arguments, text):
    write(tmp_path, PF, "pf.yaml")
    write(tmp_path, PF | {"colour": "red"}, "wrong.yaml")
    (tmp_path / "broken.yaml").write_text("a: [1\n")
    done = program(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert text in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""


def test_failed_work_ends_with_status_1_and_says_why(tmp_path):
    broken = PF | {"constraints": ["log(-1 - a**2)"]}
    done = program("run", write(tmp_path, broken), cwd=tmp_path)
    assert done.returncode == 1
    assert "could not be evaluated" in done.stderr
    assert "Traceback" not in done.stderr


def test_bundled_studies_are_installed_with_the_package():
    assert {"two_variables.yaml", "three_variables.yaml"} <= set(bundled_problems())
