# SPDX-License-Identifier: Apache-2.0
"""The one call for Python functions, and methods named in a problem file."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm

from cwmav_common.errors import InputError, WorkError
from cwmav_rbdo.optimise import optimise
from cwmav_rbdo.problem import parse_problem
from cwmav_rbdo.study import run_study

ROOT = Path(__file__).parents[3]


def margin(w, load):
    return w - load


def solve(**changes):
    arguments = {
        "objective": "w",
        "constraints": [margin],
        "design": {"w": (0.0, 10.0)},
        "random": {"load": ("normal", 3.0, 0.5)},
        "beta_target": 2.0,
        "max_true_evaluations": 30,
    }
    return optimise(**(arguments | changes))


def test_functions_and_formulas_are_one():
    by_function = solve(objective=lambda w: w)
    by_formula = solve(constraints=["w - load"])
    assert by_function.objective == pytest.approx(4.0, abs=0.01)
    assert by_formula.objective == pytest.approx(by_function.objective, abs=1e-6)


def test_scatter_may_depend_on_the_design():
    found = solve(random={"load": ("normal", 3.0, "0.1 + 0.05*w")}, constraints=["w - load"])
    # w - 3 = 2 (0.1 + 0.05 w)
    assert found.objective == pytest.approx(3.2 / 0.9, abs=0.02)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"random": {"load": ("normal", 3.0)}}, "expected \\(distribution, mean, std\\)"),
        ({"random": {"load": ("cauchy", 3.0, 1.0)}}, "dist is 'cauchy'; allowed: normal, lognormal"),
        ({"random": {"load": ("normal", 3.0, -1.0)}}, "std is -1.0; allowed: numbers > 0"),
        ({"random": {"load": ("normal", 3.0, "w - 20")}}, "std 'w - 20' gives"),
        ({"design": {"w": (1.0, 0.0)}}, "lo 1 is not below hi 0"),
        ({"constraints": [lambda w, wind: w - wind]}, "asks for wind; the problem offers w, load"),
    ],
)
def test_what_makes_no_sense_is_named(changes, message):
    with pytest.raises(InputError, match=message):
        solve(**changes)


def test_no_feasible_design_is_said_with_the_closest():
    found = solve(design={"w": (0.0, 3.2)})
    assert not found.feasible
    assert "no design holds all constraints; this one misses by" in found.message
    assert found.design["w"] == pytest.approx(3.2, abs=1e-3)
    assert found.constraints[0].band.value == pytest.approx(norm.cdf(0.4), abs=0.01)


def test_correlations_that_contradict_each_other_are_named():
    corr = (("a", "b", 0.9), ("b", "c", 0.9), ("a", "c", -0.9))
    variables = dict.fromkeys("abc", ("normal", 1.0, 0.1))
    with pytest.raises(InputError, match="correlations contradict each other"):
        solve(random=variables, constraints=["w - a - b - c"], corr=corr)


def test_a_constraint_that_gives_nan_is_excluded_with_a_note_and_never_learnt():
    def sometimes(w, load):
        return np.where(load > 4.4, np.nan, w - load)

    found = solve(constraints=[sometimes])
    assert found.objective == pytest.approx(4.0, abs=0.05)
    assert all("response 1 is nan" in note for note in found.excluded)


@pytest.mark.parametrize(
    ("method", "tolerance"),
    [("line_sampling", 0.01), ("importance_sampling", 0.2), ("subset_simulation", 0.5), ("form", 0.01)],
)
def test_a_problem_names_its_reliability_method(method, tolerance):
    problem = parse_problem(
        {
            "id": "plane",
            "kind": "reliability",
            "random": [{"name": "x", "mean": 0, "std": 1}, {"name": "y", "mean": 0, "std": 1}],
            "constraints": ["3 - 0.6*x - 0.8*y"],
            "reliability_method": method,
            "max_true_evaluations": 8000,
        },
        "test",
    )
    result = run_study(problem, seed=1)
    assert result.extra["method"] == method
    assert result.extra["pf"] == pytest.approx(norm.sf(3.0), rel=tolerance)
    assert result.true_evaluations <= 8000


def test_unknown_method_and_small_budget_are_said():
    content = {
        "id": "p",
        "kind": "reliability",
        "random": [{"name": "x", "mean": 0, "std": 1}],
        "constraints": ["3 - x"],
        "max_true_evaluations": 30,
    }
    with pytest.raises(InputError, match="reliability_method is 'luck'; allowed: active_learning"):
        parse_problem(content | {"reliability_method": "luck"}, "test")
    problem = parse_problem(content | {"reliability_method": "subset_simulation"}, "test")
    with pytest.raises(WorkError, match="subset_simulation: max_true_evaluations is too small"):
        run_study(problem)


def test_the_example_of_the_readme_runs(capsys):
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```python\n(.*?optimise\(.*?)```", text, re.DOTALL)
    assert len([line for line in example.splitlines() if line.strip()]) <= 10
    names: dict = {}
    exec(compile(example, "README.md", "exec"), names)  # noqa: S102 - our own example
    assert names["result"].objective == pytest.approx(9.52, rel=0.005)
    assert "w" in capsys.readouterr().out


def test_a_budget_that_ends_early_still_gives_the_estimate_and_says_so():
    content = {
        "id": "branches",
        "kind": "reliability",
        "random": [{"name": "x", "mean": 0, "std": 1}, {"name": "y", "mean": 0, "std": 1}],
        "constraints": ["minimum(3 + 0.1*(x-y)**2 - (x+y)/sqrt(2), 3 + 0.1*(x-y)**2 + (x+y)/sqrt(2))"],
        "max_true_evaluations": 14,
    }
    result = run_study(parse_problem(content, "test"))
    assert not result.converged
    assert "stopped at max_true_evaluations 14" in result.message
    assert result.extra["pf_std"] > 0.0
