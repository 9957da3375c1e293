# SPDX-License-Identifier: Apache-2.0
"""Rows of the lift tables run by the solver; the runs themselves are faked."""

import json
import sys

import pytest

import cwmav_sim.run
from cwmav_common.errors import WorkError
from cwmav_rbdo import cli
from cwmav_sim import case as cases
from support.sim_results import result_for


@pytest.fixture
def call(monkeypatch, capsys):
    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["cwmav-rbdo", "reproduce", *arguments])
        with pytest.raises(SystemExit) as end:
            cli.main()
        out, err = capsys.readouterr()
        return end.value.code, out, err

    return run


@pytest.fixture
def runs(monkeypatch):
    """Cases that were simulated, in order; lift grows with the angle."""
    done = []

    def simulate(case, *, out, resume):
        assert resume
        assert out.name == case.address()
        done.append(case)
        if case.flapping_frequency == 8.0:
            raise WorkError("as asked")
        return result_for(case, 0.01 * case.angle_of_attack_deg)

    monkeypatch.setattr(cwmav_sim.run, "simulate", simulate)
    return done


def test_rows_are_run_with_the_settings_asked_for_and_kept(call, runs, tmp_path):
    arguments = ["table3", "--simulate", str(tmp_path), "--preset", "smoke", "--set", "wing.model=lattice"]
    status, out, err = call(*arguments, "--json")
    found = json.loads(out)
    assert status == 0
    assert {case.wing.model for case in runs} == {"lattice"}
    assert found["runs"] == "preset smoke, wing.model=lattice"
    row = next(r for r in found["rows"] if r["paper"]["AoA_deg"] == 30.0)
    assert row["ours"]["lift_n"] == pytest.approx(0.3)
    assert row["ours"]["dp_mm"] == pytest.approx(12.0)
    assert f"1/{len(runs)}" in err
    assert cases.load_case(tmp_path / "config.yaml").wing.model == "lattice"
    before = len(runs)
    status, out, _ = call(*arguments)
    assert status == 0
    assert len(runs) - before == sum(case.flapping_frequency == 8.0 for case in runs[:before])
    assert "runs at the rows: preset smoke, wing.model=lattice" in out


def test_an_incidence_offset_shifts_every_angle_that_is_run_and_compared(call, runs, tmp_path):
    arguments = ["table3", "--simulate", str(tmp_path), "--preset", "smoke", "--json"]
    _, out, _ = call(*arguments)
    found = json.loads(out)["settings"]["incidence_offset_found_deg"]
    assert found == pytest.approx(4.18)  # the runs lift 0.01 N a degree, the rig 0.0418 N at zero angle
    before = len(runs)
    _, out, _ = call(*arguments, "--incidence-offset", "4.2")
    table = json.loads(out)
    assert {round(case.angle_of_attack_deg, 6) for case in runs[before:]} == {-5.8, 4.2, 19.2, 34.2}
    row = next(r for r in table["rows"] if r["paper"]["AoA_deg"] == 0.0)
    assert row["ours"]["lift_n"] == pytest.approx(0.042)
    assert table["settings"]["incidence_offset_deg"] == 4.2
    assert table["runs"] == "preset smoke, incidence offset 4.2 deg"
    assert any("4.2 deg added to every angle" in decision for decision in table["decisions"])


def test_table_1_takes_the_runs_of_its_spacing(call, runs, tmp_path):
    status, out, _ = call("table1", "--simulate", str(tmp_path), "--preset", "coarse", "--json")
    rows = json.loads(out)["rows"]
    assert status == 0
    assert [row["ours"] is not None for row in rows] == [True, False, False] * 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["table3", "--set", "wing.model=lattice"], "--simulate"),
        (["table3", "--simulate", "{tmp}", "--cases", "x.csv"], "exclude each other"),
        (["table3", "--simulate", "{tmp}", "--set", "wing.model=rubber"], "prescribed, membrane, lattice"),
        (["table3", "--simulate", "{tmp}", "--preset", "finest"], "smoke, coarse, fine, default, paper"),
        (["table5", "--simulate", "{tmp}"], "tables of lifts"),
        (["table1", "--incidence-offset", "3"], "allowed with: table3, all"),
        (["table1", "--simulate", "{tmp}", "--incidence-offset", "3"], "allowed with: table3, all"),
    ],
)
def test_bad_usage_is_refused(call, runs, tmp_path, arguments, message):
    status, out, err = call(*(a.format(tmp=tmp_path) for a in arguments))
    assert (status, out, runs) == (2, "", [])
    assert message in err
