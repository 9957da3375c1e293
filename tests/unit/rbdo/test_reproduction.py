# SPDX-License-Identifier: Apache-2.0
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cwmav_common.errors import InputError
from cwmav_rbdo.reproduction import report, study_runs, study_tables, surface
from cwmav_rbdo.reproduction.lift_tables import read_cases, reproduce_table1, reproduce_table3
from cwmav_rbdo.reproduction.study_tables import reproduce_history
from cwmav_rbdo.reproduction.tables import NAMES, paper_table
from cwmav_rbdo.result import Result

BOX = np.array([[4.0, -10.0, 0.0], [30.0, 60.0, 6.0]])


def grid(n, u=None):
    axes = [np.linspace(*BOX[:, k], n) for k in range(3)]
    if u is not None:
        axes[2] = np.array([u])
    return np.stack([m.ravel() for m in np.meshgrid(*axes, indexing="ij")], axis=1)


def test_surface_has_both_printed_optima_with_their_values():
    assert surface.ratio(surface.OPTIMUM_3[None])[0] == pytest.approx(0.1414)
    assert surface.ratio(surface.OPTIMUM_2[None])[0] == pytest.approx(0.1301)
    assert surface.ratio(grid(41)).max() <= 0.1414
    plane = grid(161, u=3.0)
    best = plane[np.argmax(surface.ratio(plane))]
    assert np.all(np.abs(best - surface.OPTIMUM_2) <= [0.2, 0.5, 0.0])
    assert surface.ratio(plane).max() <= 0.1301 + 1e-12


def test_reach_is_how_far_a_loss_allows():
    box = surface.reach(0.02, [0, 1, 2])
    rng = np.random.default_rng(0)
    away = rng.uniform(-1.2, 1.2, (200_000, 3)) * box
    near = away[surface.ratio(surface.OPTIMUM_3 + away) >= 0.98 * 0.1414]
    assert np.abs(near).max(axis=0) == pytest.approx(box, rel=0.05)
    assert np.all(surface.reach(0.02, [0, 1]) <= box[:2])


def test_an_optimum_off_the_lattice_says_why():
    problem = study_tables._problem("three_variables")
    printed = paper_table(NAMES["table6"])[-1]
    far = SimpleNamespace(design={"F": 10.0853, "AoA": 15.4071, "U": 4.3907}, objective=0.14137)
    (text,) = study_tables._why_not(problem, far, printed)
    assert "(F by -2.0, AoA by -3.0, U by +2.7 steps)" in text
    assert "0.14055 N/W on the surface, 0.60 % below its maximum, and predicted as 0.14137" in text
    assert "an error of 2 %" in text
    assert "9 in F, 7 in AoA, 7 in U" in text
    near = SimpleNamespace(design={"F": 10.5, "AoA": 18.0, "U": 4.15}, objective=0.1414)
    assert study_tables._why_not(problem, near, printed) == []


def test_lift_and_power_of_the_surface_make_its_ratio():
    points = grid(9)
    lift = surface.lift(points)
    assert lift / surface.law_power(lift, points) == pytest.approx(surface.ratio(points))
    answer = surface.PaperSurface().submit(np.array([10.0, np.radians(20.0), 3.0])).result()
    assert answer.lift_to_power == pytest.approx(surface.ratio(np.array([[10.0, 20.0, 3.0]]))[0])
    assert "paper_surface" in answer.lift_source


def test_surface_is_near_table_3():
    assert surface.table3_deviation() < 0.35


def test_tables_of_the_paper_are_complete():
    assert [len(paper_table(NAMES[f"table{k}"])) for k in (1, 3, 5, 6, 7)] == [2, 8, 5, 7, 4]
    last = paper_table(NAMES["table6"])[-1]
    assert (last["F_hz"], last["AoA_deg"], last["U_m_s"]) == (10.4810, 18.2278, 4.1772)


def test_table_5_lies_within_one_step_of_the_papers_lattice():
    found = reproduce_history("table5", seed=0, seeds=1, on_run=lambda: None)
    assert found["optimum"]["converged"]
    assert found["optimum"]["within_one_grid_step"]
    assert found["optimum"]["lift_to_power_n_w"] == pytest.approx(0.1301, rel=0.01)
    assert [row["iteration"] for row in found["rows"]] == list(range(len(found["rows"])))
    first = found["rows"][0]
    assert first["paper"]["F_hz"] == 12.0882
    assert set(first["paper"]) <= set(first["ours"])
    assert any("headings of Tables 5 and 6 are exchanged" in d for d in found["decisions"])


@pytest.fixture
def asked(monkeypatch):
    """Studies that were run, as method, number of variables and seed; every optimum is the same design."""
    done = []

    def run(problem, evaluator, *, seed, noise):
        done.append((problem.method, len(problem.names), seed))
        design = dict(zip(("F", "AoA", "U"), (10.36, 21.5, 3.0 + seed), strict=True))
        history = ({"lift_to_power": 0.13, "error_percent": math.nan},)
        return Result(
            "two", "lift_to_power", {n: design[n] for n in problem.names}, {}, 0.13, 0.001, (), 4 + seed, 18,
            True, True, "", history, seed,
        )  # fmt: skip

    monkeypatch.setattr(study_runs, "run_study", run)
    return done


def test_table_7_says_for_every_row_how_far_its_optimum_is_and_why(asked):
    found = study_tables.reproduce_comparison(seed=0, seeds=2, on_run=lambda: None)
    assert asked == [(m, d, s) for m in ("classical", "zhang2026") for d in (2, 3) for s in (0, 1)]
    rows = {(row["model"], row["variables"]): row for row in found["rows"]}
    assert rows["accelerated", 2]["counts"]["within_one_grid_step"] == 2
    assert rows["accelerated", 3]["counts"]["within_one_grid_step"] == 0
    assert rows["accelerated", 3]["grid_steps_apart"]["U"] == pytest.approx((3.0 - 4.1772) / 0.08)
    reasons = [d for d in found["decisions"] if "more than one step of the paper's lattice" in d]
    assert [r.partition(":")[0] for r in reasons] == ["classical, 3 variables", "accelerated, 3 variables"]
    text = "\n".join(report.lines(found))
    assert "accelerated, 2 variables: seeds 2, converged 2" in text
    assert "U 4.1772 m/s of the three-variable optimum: the conclusions print 4.7722" in text


def test_lifts_are_shown_with_their_uncertainty_and_a_common_source_once():
    text = list(report.lines(report.reproduce(["table3"], None, 0, 1, None)))
    rows = [line for line in text if " | " in line and "lift_n" in line]
    assert rows
    assert all("+- 0.0" in line for line in rows)
    assert sum("lift table" in line for line in text) == 1


def test_kept_runs_are_not_repeated(asked, tmp_path):
    first = report.reproduce(["table7"], None, 0, 2, tmp_path)
    assert len(asked) == 8
    assert len(list(tmp_path.glob("*.json"))) == 8
    again = report.reproduce(["table7"], None, 0, 3, tmp_path)
    assert asked[8:] == [(m, d, 2) for m in ("classical", "zhang2026") for d in (2, 3)]
    assert [r["ours"] for r in again["rows"]] == [r["ours"] for r in first["rows"]]
    problem = study_tables._problem("two_variables")
    (fresh,) = study_runs.study_runs(problem, 0, 1, lambda: None)
    (kept,) = study_runs.study_runs(problem, 0, 1, lambda: None, tmp_path)
    assert repr(kept.history[0]) == repr(fresh.history[0])
    assert len(asked) == 13  # the fresh one alone
    other = replace(problem, initial_samples=7)
    study_runs.study_runs(other, 0, 1, lambda: None, tmp_path)
    assert len(asked) == 14
    broken = sorted(tmp_path.glob("*.json"))[0]
    broken.write_text("{}")
    with pytest.raises(InputError, match="is no run of this study; delete it"):
        report.reproduce(["table7"], None, 0, 3, tmp_path)


CASES = "F_hz,U_m_s,AoA_deg,mean_lift_n,lift_std_n,dp_m,preset\n"


def test_runs_are_put_beside_table_3_and_table_1_and_gaps_are_said(tmp_path):
    path = tmp_path / "cases.csv"
    path.write_text(
        CASES
        + "12,3.5,15,0.10,0.001,0.008,coarse\n12,3.5,15,0.15,0.001,0.004,default\n"
        + "16,3.5,-10,-0.02,,0.008,coarse\n"
    )
    cases = read_cases(path)
    three = reproduce_table3(cases)["rows"]
    assert three[0]["ours"]["lift_n"] == 0.15  # the finest at that point
    assert three[0]["difference_percent"] == pytest.approx(100 * (0.15 / 0.1616 - 1))
    assert three[1]["ours"] is None
    assert three[1]["note"] == "no result at this point"
    negative = next(r for r in three if r["paper"]["AoA_deg"] == -10)
    assert negative["difference_percent_with_minus_sign"] == pytest.approx(100 * (-0.02 + 0.0223) / 0.0223)
    one = reproduce_table1(cases)["rows"]
    assert [(r["paper"]["dp_mm"], r["ours"] and r["ours"]["lift_n"]) for r in one[:3]] == [
        (8, 0.10),
        (4, 0.15),
        (2, None),
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("F_hz,U_m_s\n1,2\n", "column AoA_deg, mean_lift_n is missing"),
        (CASES + "12,3.5,x,0.1,,,\n", "line 2: AoA_deg is 'x'; allowed: a number"),
        (CASES + "12,3.5,,0.1,,,\n", "line 2: an empty cell"),
    ],
)
def test_unusable_file_of_runs_is_refused(tmp_path, text, message):
    path = tmp_path / "cases.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_cases(path)


def test_spacings_cannot_be_compared_without_runs():
    with pytest.raises(InputError, match="give --cases"):
        reproduce_table1(None)
    with pytest.raises(InputError, match="table 'table2' is unknown; allowed: table1, table3"):
        report.chosen("table2")
