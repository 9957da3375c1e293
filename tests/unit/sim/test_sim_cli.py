# SPDX-License-Identifier: Apache-2.0
"""The program cwmav-sim as a user meets it: exit statuses, JSON, messages. The flow itself is faked."""

import json
import sys

import numpy as np
import pytest

from cwmav_sim import cli, devices
from cwmav_sim.benchmark import CardFigures
from cwmav_sim.cuda.device import Card
from cwmav_sim.verification import catalogue
from cwmav_sim.verification.protocol import Check
from support.sim_flow import StillFlow


class SteadyFlow(StillFlow):
    """Air that pushes each wing up with the same force at every step."""

    def loads(self, time):
        pressure = np.zeros((2, 3))
        pressure[:, 2] = 0.04
        return pressure, np.zeros((2, 3)), np.zeros(2)


@pytest.fixture(autouse=True)
def steady_flow(monkeypatch):
    monkeypatch.setattr(devices, "Solver", SteadyFlow)


@pytest.fixture
def call(monkeypatch, capsys):
    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["cwmav-sim", *arguments])
        with pytest.raises(SystemExit) as end:
            cli.main()
        out, err = capsys.readouterr()
        return end.value.code, out, err

    return run


def test_run_prints_one_json_object(call):
    status, out, err = call("run", "-F", "16", "-A", "15", "-U", "3.5", "--preset", "smoke", "--json")
    content = json.loads(out)
    assert status == 0
    assert content["mean_lift_n"] == pytest.approx(0.16)
    assert content["preset"] == "smoke"
    assert (content["F_hz"], content["AoA_deg"], content["U_m_s"]) == (16, 15, 3.5)
    assert err == ""


def test_run_for_people_says_lift_and_source(call):
    status, out, _ = call("run", "-F", "12")
    assert status == 0
    assert "lift    0.1600" in out
    assert "SPH smoke, 12 mm, half model" in out


def test_settings_can_be_changed(call, tmp_path):
    status, out, _ = call("run", "--set", "run.cycles=5", "--set", "run.cycles_max=5", "--json")
    assert status == 0
    assert json.loads(out)["cycles"] == 5


def test_case_file_is_used(call, tmp_path):
    (tmp_path / "mine.yaml").write_text("preset: smoke\nairspeed: 2\nrun: {cycles: 4, cycles_max: 4}\n")
    status, out, _ = call("run", "--case", str(tmp_path / "mine.yaml"), "-F", "10", "--json")
    content = json.loads(out)
    assert status == 0
    assert (content["F_hz"], content["U_m_s"], content["cycles"]) == (10, 2, 4)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "-F", "50"], "flapping_frequency"),
        (["run", "-A", "90"], "angle_of_attack_deg"),
        (["run", "-U", "-1"], "airspeed"),
        (["run", "--preset", "finest"], "smoke, coarse, fine, default, paper"),
        (["run", "--set", "flow.resolution.dp=-1"], "dp"),
        (["run", "--set", "nonsense=1"], "nonsense"),
        (["run", "--device", "cuda"], "allowed here: cpu"),
        (
            ["sweep", "absent.csv", "--out", "somewhere", "--device", "cuda"],
            "missing: a card with its driver",
        ),
        (["bench", "--device", "abacus"], "cpu, cuda"),
        (["run", "--case", "absent.yaml"], "absent.yaml"),
        (["run", "--snapshots", "4"], "--out"),
        (["run", "--resume"], "--out"),
        (["sweep", "absent.csv", "--out", "somewhere"], "absent.csv"),
        (["verify", "nonsense"], "nonsense"),
        (["run", "--nonsense"], "--nonsense"),
    ],
)
def test_bad_input_ends_with_two_and_no_traceback(call, monkeypatch, arguments, message):
    monkeypatch.setattr("cwmav_sim.cuda.device.find_card", lambda: Card("", "a card with its driver"))
    status, out, err = call(*arguments)
    assert status == 2
    assert message in err
    assert out == ""
    assert "Traceback" not in err


def test_failing_flow_ends_with_one(call, monkeypatch):
    class Exploding(SteadyFlow):
        def step(self):
            info = super().step()
            info.pressure[:] = np.nan
            return info

    monkeypatch.setattr(devices, "Solver", Exploding)
    status, out, err = call("run", "--json")
    assert (status, out) == (1, "")
    assert "became undefined" in err


def test_sweep_lists_results_and_resumes(call, tmp_path):
    table, out_folder = tmp_path / "cases.csv", tmp_path / "sweep"
    table.write_text("F_hz,U_m_s,AoA_deg\n12,3.5,15\n16,3.5,15\n")
    status, out, err = call("sweep", str(table), "--out", str(out_folder), "--json")
    content = json.loads(out)
    assert status == 0
    assert [c["F_hz"] for c in content["cases"]] == [12, 16]
    assert content["failed"] == []
    assert "case 2 of 2" in err
    first = (out_folder / "sweep.csv").read_text()

    class Never(SteadyFlow):
        def step(self):
            raise AssertionError("a stored case was computed again")

    devices.Solver = Never
    status, _, _ = call("sweep", str(table), "--out", str(out_folder), "--json")
    assert status == 0
    assert (out_folder / "sweep.csv").read_text() == first


def test_points_are_written_for_a_sweep(call, tmp_path):
    path = tmp_path / "points.csv"
    status, out, _ = call("points", str(path), "--count", "5", "-U", "3", "--json")
    assert status == 0
    assert len(json.loads(out)["points"]) == 5
    assert path.read_text().splitlines()[0] == "F_hz,U_m_s,AoA_deg"


def test_verify_lists_its_cases(call):
    status, out, _ = call("verify", "--list", "--json")
    names = [entry["name"] for entry in json.loads(out)["cases"]]
    assert status == 0
    assert "still-air" in names
    assert len(names) == len(set(names))


def test_sweeps_are_gathered_into_one_table(call, tmp_path):
    for part, angles in (("a", (0, 10, 20, 30, 40)), ("b", (5, 15, 25, 35, 10))):
        lines = [f"{10 + k},3,{angle}" for k, angle in enumerate(angles)]
        (tmp_path / f"{part}.csv").write_text("\n".join(["F_hz,U_m_s,AoA_deg", *lines]) + "\n")
        call("sweep", str(tmp_path / f"{part}.csv"), "--out", str(tmp_path / part))
    out = tmp_path / "table.csv"
    status, text, _ = call("table", str(out), str(tmp_path / "a"), str(tmp_path / "b"), "--json")
    content = json.loads(text)
    assert status == 0
    assert content["rows"] == 10
    assert "10 SPH runs at 12 mm" in content["source"]
    assert len(out.read_text().splitlines()) == 11


def test_gathering_from_a_folder_that_is_none_is_bad_input(call, tmp_path):
    status, _, err = call("table", str(tmp_path / "t.csv"), str(tmp_path / "absent"))
    assert status == 2
    assert "absent" in err


class StubCase:
    """A verification case with one right and one wrong number."""

    name, summary, slow = "stub", "two numbers", False
    remark = "the air was never asked."

    def run(self):
        right = Check("stub", "mass [kg]", 1.05, 1.0, 1.0, 10.0, "a book")
        return [right, Check("stub", "speed [m/s]", float("nan"), 0.0, 60.0, 0.1, "a law")]


def test_verify_reports_every_check_and_fails_when_one_does(call, monkeypatch):
    monkeypatch.setattr(catalogue, "catalogue", lambda: (StubCase(),))
    status, out, err = call("verify", "stub", "--json")
    first, second = json.loads(out)["cases"]
    assert status == 1
    assert "1 of 2 checks failed" in err
    assert first["passed"] is True
    assert first["error_percent"] == pytest.approx(5.0)
    assert (second["passed"], second["value"]) == (False, None)
    assert {"name", "quantity", "reference", "tolerance_percent", "source"} <= set(first)


def test_verify_keeps_the_last_result_of_every_case(call, monkeypatch, tmp_path):
    monkeypatch.setattr(catalogue, "catalogue", lambda: (StubCase(),))
    (tmp_path / "verification.json").write_text(
        json.dumps(
            {
                "older": {
                    "summary": "kept",
                    "long": True,
                    "date": "2026-01-01 00:00",
                    "commit": "abc",
                    "solver": "def",
                    "machine": "m",
                    "seconds": 5.0,
                    "checks": [],
                },
                "stub": {},
            }
        )
    )
    call("verify", "stub", "--record", str(tmp_path))
    text = (tmp_path / "verification.md").read_text()
    assert "| [stub](#stub) | **1 of 2 missed** |" in text
    assert "| speed [m/s] | undefined | 0 | undefined % | 0.1 % | **missed** |" in text
    assert "| mass [kg] | 1.05 | 1 | 5 % | 10 % | pass |" in text
    assert "[older](#older) (long)" in text
    assert "Why: the air was never asked." in text
    assert set(json.loads((tmp_path / "verification.json").read_text())) == {"older", "stub"}


def test_verify_refuses_a_damaged_record(call, monkeypatch, tmp_path):
    monkeypatch.setattr(catalogue, "catalogue", lambda: (StubCase(),))
    (tmp_path / "verification.json").write_text("{")
    status, _, err = call("verify", "stub", "--record", str(tmp_path))
    assert status == 2
    assert "verification.json" in err


def test_bench_of_a_card_prints_its_rate(call, monkeypatch):
    figures = CardFigures("Some Card", 2_100_000, 10, 0.14, 164.0, {"card": 1.0})
    asked = []
    monkeypatch.setattr("cwmav_sim.cuda.device.find_card", lambda: Card("Some Card", ""))
    monkeypatch.setattr("cwmav_sim.benchmark.measure_card", lambda n: asked.append(n) or figures)
    status, out, _ = call("bench", "--device", "cuda", "--json")
    assert (status, asked) == (0, [2_100_000])
    content = json.loads(out)
    assert content["particle_steps_per_s"] == pytest.approx(150e6)
    assert (content["card"], content["aim_particle_steps_per_s"]) == ("Some Card", 150e6)
