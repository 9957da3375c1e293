# SPDX-License-Identifier: Apache-2.0
import csv
import math
from dataclasses import dataclass
from importlib import resources

import pytest

from cwmav_rbdo.criteria import CriteriaSettings, judge, mean_square_error, relative_change, relative_error


@dataclass(frozen=True)
class Row:
    prediction: float
    response: float
    feasible: bool = True


def paper_rows(name):
    """Rows of a table of the paper; the response is what makes the printed error."""
    text = (resources.files("cwmav_rbdo") / "data" / name).read_text(encoding="utf-8")
    rows = csv.DictReader(text.splitlines())
    return [
        Row(
            float(r["lift_to_power_n_w"]),
            float(r["lift_to_power_n_w"]) / (1.0 + float(r["error_percent"]) / 100.0),
            float(r["reliability"]) >= 0.9974,
        )
        for r in rows
    ]


def first_stop(rows, **settings):
    stops = [k for k in range(len(rows)) if judge(rows[: k + 1], CriteriaSettings(**settings)).converged]
    return stops[0] if stops else None


def test_table_5_stops_where_the_paper_stopped():
    assert first_stop(paper_rows("table5_two_variables.csv")) == 4


def test_table_6_holds_the_criteria_one_iteration_before_the_paper_stopped():
    rows = paper_rows("table6_three_variables.csv")
    assert first_stop(rows) == 5
    assert first_stop(rows, extra_confirmations=1) == 6


def test_each_criterion_alone_keeps_the_loop_going():
    good = [Row(0.130, 0.131), Row(0.131, 0.130)]
    assert judge(good, CriteriaSettings()).converged
    assert not judge(good[1:], CriteriaSettings()).converged
    assert not judge([Row(0.130, 0.14), good[1]], CriteriaSettings()).error_small
    assert not judge([Row(0.110, 0.111), good[1]], CriteriaSettings()).change_small
    unreliable = judge([good[0], Row(0.131, 0.130, feasible=False)], CriteriaSettings())
    assert unreliable.error_small
    assert unreliable.change_small
    assert not unreliable.converged


def test_the_strict_end_asks_for_certainty_and_twice_no_promise():
    @dataclass(frozen=True)
    class Strict(Row):
        certain: bool = True
        promise: float = 0.001

    good, hoping = Strict(0.130, 0.131), Strict(0.130, 0.131, promise=0.02)
    settings = CriteriaSettings()
    assert judge([good, good], settings, strict=True).converged
    assert judge([hoping, hoping], settings).converged
    assert not judge([good, hoping], settings, strict=True).converged
    assert not judge([hoping, good], settings, strict=True).converged
    assert not judge([good, Strict(0.130, 0.131, certain=False)], settings, strict=True).converged
    assert judge([good, Strict(0.130, 0.131, promise=math.nan)], settings, strict=True).converged


def test_an_optimum_that_could_not_be_evaluated_never_satisfies_cc1():
    assert not judge([Row(0.13, 0.13), Row(0.13, math.nan)], CriteriaSettings()).error_small


def test_equations_12_13_and_10():
    assert relative_error(0.11, 0.1) == pytest.approx(0.1)
    assert relative_change(0.12, 0.1) == pytest.approx(0.2)
    assert relative_error(0.1, 0.0) == math.inf
    assert mean_square_error([Row(1.0, 2.0), Row(5.0, 2.0), Row(9.0, math.nan)]) == pytest.approx(5.0)
    assert math.isnan(mean_square_error([Row(1.0, math.nan)]))
