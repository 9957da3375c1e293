# SPDX-License-Identifier: Apache-2.0
import json

import numpy as np
import pytest
import yaml

from cwmav_common.errors import InputError, WorkError
from cwmav_rbdo.expressions import compile_function
from cwmav_rbdo.problem import (
    bundled_problems,
    digest,
    load_problem,
    parse_problem,
    parse_text,
    problem_mapping,
)
from cwmav_rbdo.study import run_study
from support.ratio_bowl import BowlEvaluator

COLUMN = {
    "id": "column",
    "kind": "rbdo",
    "design": [{"name": "b", "lo": 150, "hi": 350, "start": 200}, {"name": "h", "lo": 150, "hi": 350}],
    "random": [
        {"name": "k", "dist": "lognormal", "mean": 0.6, "cov": 0.1},
        {"name": "E", "dist": "normal", "mean": 10000, "std": 500},
    ],
    "corr": [],
    "let": [["I", "b*h**3/12"]],
    "objective": "b*h",
    "constraints": ["k*pi**2*E*I/9e6 - 1.4e6"],
    "beta_target": 3.0,
    "max_true_evaluations": 200,
}
WING = yaml.safe_load(bundled_problems()["two_variables.yaml"].read_text())


def without(mapping, *keys):
    return {k: v for k, v in mapping.items() if k not in keys}


def test_bundled_studies_are_the_papers():
    two, three = load_problem("two_variables.yaml"), load_problem("three_variables")
    assert two.names == ("F", "AoA")
    assert three.names == ("F", "AoA", "U")
    assert three.lower.tolist() == [4, -10, 0]
    assert three.upper.tolist() == [30, 60, 6]
    assert (two.initial_samples, three.initial_samples) == (6, 20)
    assert (two.require.lift_to_power, three.require.lift_to_power) == (0.12, 0.125)
    assert two.require.reliability == three.require.reliability == 0.9974
    assert (two.criteria.c1, two.criteria.c2, two.window.q, two.window.rule) == (0.02, 0.03, 0.25, "range")
    assert (two.swarm.particles, two.swarm.iterations) == (1000, 1000)
    assert two.method == three.method == "zhang2026"


def test_where_lift_and_power_come_from_is_read_from_the_file():
    sources = {"fidelity": "coarse", "workers": 3, "coarse_lifts": "cases.csv", "recordings": ["bags/one"]}
    problem = parse_problem(WING | {"source": sources, "note": "ignored"}, "file")
    assert {name: getattr(problem.source, name) for name in ("fidelity", "workers", "coarse_lifts")} == {
        name: sources[name] for name in ("fidelity", "workers", "coarse_lifts")
    }
    assert list(problem.source.recordings) == ["bags/one"]
    assert parse_problem(json.loads(json.dumps(problem_mapping(problem))), "again") == problem
    with pytest.raises(InputError, match="workers"):
        parse_problem(WING | {"source": {"workers": 0}}, "file")
    collected = parse_problem(COLUMN | {"source": "a book", "published": {"f": 1.0}}, "file")
    assert collected == parse_problem(COLUMN, "file")


@pytest.mark.parametrize("content", [WING, COLUMN])
def test_resolved_problem_reads_back_as_itself(content):
    problem = parse_problem(content, "file")
    assert parse_problem(json.loads(json.dumps(problem_mapping(problem))), "again") == problem
    assert parse_text(yaml.safe_dump(content)) == problem


def test_fingerprint_follows_what_changes_answers_and_nothing_else():
    problem = parse_problem(WING, "file")
    assert digest(problem) == digest(parse_problem(WING | {"evaluate": "table", "title": "other"}, "file"))
    assert digest(problem) != digest(parse_problem(WING | {"initial_samples": 7}, "file"))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"kind": "magic"}, "kind is 'magic'; allowed: lift_to_power, rbdo, reliability, global"),
        (
            {"design": [{"name": "F", "lo": 30, "hi": 4}, {"name": "AoA", "lo": 0, "hi": 1}]},
            "lo 30 is not below hi 4",
        ),
        (
            {"design": [{"name": "AoA", "lo": 0, "hi": 1}, {"name": "F", "lo": 4, "hi": 30}]},
            "in the order F, AoA, U",
        ),
        ({"fixed": {}}, "U is neither in design nor in fixed"),
        ({"fixed": {"U": 3, "F": 4}}, "F is both in design and in fixed"),
        ({"fixed": {"U": 3, "V": 4}}, "'V' is no control variable; allowed: F, AoA, U"),
        ({"noise": {"F": 0.1}}, "noise: AoA, U is missing"),
        ({"noise": {"F": 0.1, "AoA": -1, "U": 0}}, "noise: AoA is -1"),
        ({"noise": "guessed"}, "noise is 'guessed'; allowed: measured"),
        ({"method": "luck"}, "method is 'luck'; allowed: default, zhang2026, classical, or python:"),
        ({"window": {"q": 3, "rule": "range"}}, "'window.q' is 3; allowed: float > 0 and <= 1"),
        ({"require": {"lift_to_power": 0.1, "reliability": 2}}, "'require.reliability' is 2"),
        ({"initial_sample": 3}, "unknown key 'initial_sample'"),
        ({"require": {"reliability": 0.99}}, "require.lift_to_power is missing; goal ratio needs it"),
        ({"goal": "least_power"}, "require.lift is missing; goal least_power needs it, in N"),
        ({"noise": {"F": "0.1*G", "AoA": 1, "U": 0}}, "noise: F: '0.1*G' uses 'G'; allowed here: F, AoA, U"),
        ({"max_true_evaluations": 6}, "leaves nothing after initial_samples 6"),
    ],
)
def test_wrong_wing_study_names_file_value_and_what_is_allowed(change, text):
    with pytest.raises(InputError) as caught:
        parse_problem(WING | change, "case.yaml")
    assert str(caught.value).startswith("case.yaml: ")
    assert text in str(caught.value)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"constraints": ["k*w"]}, "constraints[0]: 'k*w' uses 'w'; allowed here: b, h, k, E, I, pi, e"),
        ({"objective": "b*k"}, "objective: 'b*k' uses 'k'; allowed here: b, h"),
        ({"let": [["I", "b*"]]}, "let[0] I: 'b*' is not a formula"),
        ({"let": [["b", "h"]]}, "'b' is declared twice"),
        ({"let": [["sin", "h"]]}, "'sin' cannot be a name"),
        ({"beta_target": None}, "exactly one of beta_target, pf_target and reliability_target"),
        ({"beta_target": [3, 3]}, "2 values for 1 constraints"),
        ({"beta_target": None, "pf_target": 2.0}, "pf_target: 2.0 is not allowed"),
        ({"random": [{"name": "k", "mean": "z", "std": 1}]}, "mean 'z' is no number and no design variable"),
        ({"random": [{"name": "k", "mean": 1}]}, "exactly one of std and cov"),
        ({"corr": [["k", "q", 0.5]]}, "corr [k, q, 0.5]"),
        ({"corr": [["k", "E", 1.0]]}, "a correlation above -1 and below 1"),
        (
            {"corr": [["k", "E", 0.5], ["E", "k", 0.4]]},
            "corr [E, k, 0.4]: the correlation of the two is given",
        ),
        (
            {
                "random": [{"name": n, "mean": 1, "std": 1} for n in "kEx"],
                "corr": [["k", "E", 0.6], ["k", "x", 0.8]],
            },
            "corr: the correlations contradict each other, or leave a variable no freedom of its own",
        ),
        ({"constraints": []}, "kind 'rbdo' needs constraints"),
        ({"constraints": ["python:no_such_module:f"]}, "cannot be imported"),
        ({"constraints": ["python:math"]}, "expected python:package.module:function"),
        ({"constraints": ["python:math:pi"]}, "is a float, not a function"),
    ],
)
def test_wrong_general_problem_names_place_and_what_is_allowed(change, text):
    with pytest.raises(InputError) as caught:
        parse_problem(COLUMN | change, "column.yaml")
    assert str(caught.value).startswith("column.yaml: ")
    assert text in str(caught.value)


def test_targets_become_reliability_indices():
    pf = parse_problem(without(COLUMN, "beta_target") | {"pf_target": 0.05}, "f")
    assert pf.beta_targets == pytest.approx((1.6448536,))
    reliability = parse_problem(without(COLUMN, "beta_target") | {"reliability_target": [0.9974]}, "f")
    assert reliability.beta_targets == pytest.approx((2.7944,), abs=1e-4)


def test_formulas_are_evaluated_over_rows_with_lets():
    functions = parse_problem(COLUMN, "f").functions
    rows = {
        "b": np.array([2.0, 3.0]),
        "h": np.array([1.0, 2.0]),
        "k": np.array([1.0, 1.0]),
        "E": np.array([9e6, 9e6]),
    }
    expected = np.pi**2 * rows["b"] * rows["h"] ** 3 / 12 - 1.4e6
    assert functions.limit_states(rows)[:, 0] == pytest.approx(expected)
    assert functions.minimised(rows).tolist() == [2.0, 6.0]
    turned = parse_problem(COLUMN | {"objective": "maximise: b*h"}, "f").functions
    assert turned.minimised(rows).tolist() == [-2.0, -6.0]


def test_bounds_make_the_design_of_a_global_problem():
    problem = parse_problem(
        {"id": "g", "kind": "global", "bounds": [[-5, 10], [0, 15]], "objective": "x1+x2"}, "f"
    )
    assert problem.names == ("x1", "x2")
    assert problem.upper.tolist() == [10, 15]


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')",
        "x.__class__",
        "().__class__.__bases__",
        "[x for x in (1, 2)]",
        "lambda: 1",
        "x if x else 1",
        "x[0]",
        "'text'",
        "open('f')",
        "sin",
        "sqrt(x=2)",
        "x and 1",
        "(y := 3)",
        "f'{x}'",
        "True",
    ],
)
def test_formula_that_is_more_than_arithmetic_is_refused_before_it_runs(text):
    with pytest.raises(InputError, match="^here: "):
        compile_function(text, ["x"], "here")


def test_function_of_the_users_own_gets_the_arrays_it_names(tmp_path, monkeypatch):
    (tmp_path / "my_model.py").write_text("def f(k, E, scale=2.0):\n    return scale * k + E\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    f = compile_function("python:my_model:f", ["b", "k", "E"], "here")
    rows = {"b": np.zeros(2), "k": np.array([1.0, 2.0]), "E": np.array([0.5, 0.5])}
    assert f(rows).tolist() == [2.5, 4.5]
    with pytest.raises(InputError, match="asks for E; the problem offers b, k"):
        compile_function("python:my_model:f", ["b", "k"], "here")


def test_formula_that_cannot_be_computed_is_a_failure_not_a_number():
    f = compile_function("x ** (10 ** 10)", ["x"], "here")
    with pytest.raises(WorkError, match="cannot be evaluated"):
        f({"x": np.array([2.0])})
    undefined = compile_function("log(x)", ["x"], "here")({"x": np.array([-1.0])})
    assert np.isnan(undefined[0])


def test_missing_file_names_the_bundled_ones(tmp_path):
    with pytest.raises(InputError, match="no such file; bundled problems: .*two_variables.yaml"):
        load_problem(tmp_path / "absent.yaml")


SCATTERED = """
id: scattered
kind: lift_to_power
design: [{name: F, lo: 4, hi: 30}, {name: AoA, lo: -10, hi: 60}]
fixed: {U: 3.0}
noise: {F: "0.1 + 0.02*F", AoA: 0.9, U: 0.05}
distribution: {AoA: uniform}
corr: [[F, AoA, 0.5], [AoA, U, -0.2]]
require: {lift_to_power: 0.12, reliability: 0.99}
method: default
max_true_evaluations: 30
swarm: {particles: 60, iterations: 60, patience: 15}
"""


def test_scatter_of_a_file_is_used_and_read_back():
    problem = parse_text(SCATTERED)
    assert parse_problem(problem_mapping(problem), "again") == problem
    result = run_study(problem, BowlEvaluator(), seed=2)
    assert result.feasible
    assert result.extra["noise"]["scatter"]["AoA"]["distribution"] == "uniform"
    assert "AoA scatters with a uniform distribution around its setting" in result.decisions
    assert "scatter of F and AoA is correlated by a Gaussian copula, 0.5" in result.decisions


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("distribution: {AoA: cauchy}", "distribution: AoA is 'cauchy'"),
        ("distribution: {lift: normal}", "distribution: lift is 'normal'"),
        ("distribution: {AoA: lognormal}", "AoA is 'lognormal', which needs positive values; its lo is -10"),
        ("corr: [[F, lift, 0.5]]", r"corr \[F, lift, 0.5\]: expected two different"),
        ("corr: [[F, AoA, 1.5]]", r"corr \[F, AoA, 1.5\]"),
        ("corr: [[F, AoA, 0.9], [AoA, U, 0.9], [F, U, -0.9]]", "the correlations contradict each other"),
    ],
)
def test_impossible_scatter_is_refused(line, message):
    kept = [row for row in SCATTERED.splitlines() if not row.startswith(line.partition(":")[0])]
    with pytest.raises(InputError, match=message):
        parse_text("\n".join([*kept, line]))
