# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.special import ndtr, ndtri

from cwmav_common.errors import InputError, WorkError
from cwmav_rbdo.evaluators import FormulaEvaluator
from cwmav_rbdo.general.variables import RandomSpace
from cwmav_rbdo.general.worst_point import worst_point
from cwmav_rbdo.problem import parse_problem
from cwmav_rbdo.result import Band, Constraint, Result
from cwmav_rbdo.run_folder import RunFolder
from cwmav_rbdo.study import run_study
from cwmav_rbdo.text import summary_lines

YOUN_CHOI = {
    "id": "youn_choi",
    "kind": "rbdo",
    "design": [{"name": "d1", "lo": 0, "hi": 10, "start": 5}, {"name": "d2", "lo": 0, "hi": 10, "start": 5}],
    "random": [{"name": "x1", "mean": "d1", "std": 0.3}, {"name": "x2", "mean": "d2", "std": 0.3}],
    "objective": "d1+d2",
    "constraints": ["x1**2*x2/20-1", "(x1+x2-5)**2/30+(x1-x2-12)**2/120-1", "80/(x1**2+8*x2+5)-1"],
    "beta_target": 3.0,
    "max_true_evaluations": 47,
}
LINEAR = {
    "id": "linear",
    "kind": "reliability",
    "random": [{"name": "a", "mean": 3, "std": 1}, {"name": "b", "mean": 0, "std": 1}],
    "constraints": ["a + 0*b"],
}


def true_betas(problem, design, n=1_000_000):
    """Reliability indices of the formulas themselves, by an independent Monte Carlo."""
    space = RandomSpace(problem)
    U = np.random.default_rng(12345).standard_normal((n, space.dimension))
    X = space.physical(U, np.array(list(design.values())))
    g = problem.functions.limit_states(dict(zip(space.names, X.T, strict=True)))
    return -ndtri(np.clip((g <= 0).mean(axis=0), 1e-9, 1.0))


@pytest.fixture(scope="module")
def youn_choi():
    problem = parse_problem(YOUN_CHOI, "youn_choi")
    return problem, run_study(problem, seed=0)


def test_published_problem_is_solved_in_a_tenth_of_the_classical_evaluations(youn_choi):
    problem, result = youn_choi
    assert result.converged
    assert result.true_evaluations <= 47
    assert result.objective == pytest.approx(6.72859, rel=0.005)
    betas = true_betas(problem, result.design)
    assert betas[:2] == pytest.approx([3.0, 3.0], abs=0.05)
    assert betas[2] > 3.0


def test_reported_reliabilities_are_those_of_the_formulas(youn_choi):
    problem, result = youn_choi
    own = ndtri([c.band.value for c in result.constraints[:2]])
    assert own == pytest.approx(true_betas(problem, result.design)[:2], abs=0.03)
    assert [c.name for c in result.constraints] == list(problem.constraints)


def test_constraint_that_never_acts_changes_nothing(youn_choi):
    _, result = youn_choi
    more = parse_problem(YOUN_CHOI | {"constraints": [*YOUN_CHOI["constraints"], "x1 + 1000"]}, "more")
    again = run_study(more, seed=0)
    assert again.design == pytest.approx(dict(result.design), abs=1e-3)
    assert again.constraints[3].band.value == 1.0


def test_infeasible_problem_is_said_plainly_with_the_miss():
    task = YOUN_CHOI | {"constraints": ["x1 + x2 - 30"], "max_true_evaluations": 25}
    result = run_study(parse_problem(task, "infeasible"), seed=0)
    assert not result.feasible
    assert not result.converged
    assert "no design holds all constraints; this one misses by" in result.message
    assert result.constraints[0].band.value < 1e-6


def test_objective_that_is_no_number_is_an_error_that_says_where():
    task = YOUN_CHOI | {"objective": "sqrt(-1 - d1**2)"}
    with pytest.raises(WorkError, match=r"the objective is nan at d1 [\d.e-]+, d2 [\d.e-]+"):
        run_study(parse_problem(task, "nowhere"), seed=0)
    # Undefined in a part of the space only: the optimum lies elsewhere.
    task = YOUN_CHOI | {"objective": "d1 + d2 + 0*sqrt(9.5 - d1)"}
    result = run_study(parse_problem(task, "partly"), seed=0)
    assert result.objective == pytest.approx(6.7286, rel=5e-3)


def test_constraint_that_fails_everywhere_is_said_plainly():
    task = YOUN_CHOI | {"constraints": ["0*x1 - 1"], "max_true_evaluations": 25}
    result = run_study(parse_problem(task, "hopeless"), seed=0)
    assert not result.feasible
    assert "no design holds all constraints; this one fails whatever its scatter" in result.message
    assert not result.constraints[0].met
    assert result.constraints[0].band.value < 1e-6


def test_optimum_on_its_limit_is_met_to_the_error_of_its_reliability():
    def constraint(value):
        return Constraint("g", Band(value, 4e-5, 0.0, 1.0, "monte_carlo"), 0.99865)

    verdicts = {0.99866: True, 0.99860: True, 0.99856: False}
    assert {value: constraint(value).met for value in verdicts} == verdicts
    lines = [
        line
        for value in verdicts
        for line in summary_lines(
            Result("g", "rbdo", {"d": 2.0}, {}, 1.0, 0.0, (constraint(value),), 1, 9, True, True, "", (), 0)
        )
        if "required" in line
    ]
    assert [line.partition(") ")[2] for line in lines] == ["met", "met to that error", "NOT met"]


def test_same_seed_same_result_and_a_resumed_run_evaluates_only_what_is_missing(tmp_path, youn_choi):
    problem, expected = youn_choi
    calls = []

    class Limited(FormulaEvaluator):
        def __init__(self, stop_after):
            super().__init__(problem, RandomSpace(problem).names)
            self.stop_after = stop_after

        def submit(self, point):
            if len(calls) >= self.stop_after:
                raise KeyboardInterrupt
            calls.append(tuple(point))
            return super().submit(point)

    folder = RunFolder.create(tmp_path, problem.id)
    with pytest.raises(KeyboardInterrupt):
        run_study(problem, Limited(15), seed=0, run_folder=folder)
    result = run_study(problem, Limited(1000), seed=0, run_folder=folder, resume=True)
    assert len(calls) == len(set(calls)) == result.true_evaluations
    assert result.to_json() == expected.to_json()
    assert folder.result.exists()


def test_failure_probability_of_a_linear_limit_state_is_exact():
    result = run_study(parse_problem(LINEAR, "linear"), seed=1)
    values = result.to_json()
    assert values["pf"] == pytest.approx(ndtr(-3.0), rel=0.05)
    assert abs(values["beta"] - 3.0) < 0.02
    assert values["true_evaluations"] < 60


def test_summary_of_a_failure_probability_names_no_design():
    result = run_study(parse_problem(LINEAR, "linear"), seed=1)
    (line,) = summary_lines(result)
    assert line.startswith("status    failure probability 0.0013")


def test_several_constraints_of_a_reliability_problem_are_a_series_system():
    two = LINEAR | {"constraints": ["a - 1", "5 - a"]}
    values = run_study(parse_problem(two, "two"), seed=1).to_json()
    assert values["pf"] == pytest.approx(2 * ndtr(-2.0), rel=0.05)


def test_global_problem_reaches_the_known_least_value():
    branin = {
        "id": "branin",
        "kind": "global",
        "bounds": [[-5, 10], [0, 15]],
        "objective": "(x2-5.1/(4*pi**2)*x1**2+5/pi*x1-6)**2+10*(1-1/(8*pi))*cos(x1)+10",
        "max_true_evaluations": 60,
    }
    result = run_study(parse_problem(branin, "branin"), seed=0)
    assert result.objective == pytest.approx(0.397887, abs=1e-2)
    turned = branin | {"objective": "maximise: -(" + branin["objective"] + ")"}
    assert run_study(parse_problem(turned, "turned"), seed=0).objective == pytest.approx(-result.objective)


def test_point_where_a_formula_is_undefined_is_excluded_with_its_reason():
    task = LINEAR | {
        "kind": "global",
        "random": [],
        "constraints": [],
        "bounds": [[-1, 4]],
        "max_true_evaluations": 20,
    }
    result = run_study(parse_problem(task | {"objective": "sqrt(x1) + (x1 - 2)**2"}, "root"), seed=0)
    assert result.excluded
    assert all("response 1 is nan" in reason for reason in result.excluded)
    assert result.design["x1"] == pytest.approx(1.8, abs=0.1)
    broken = parse_problem(task | {"objective": "sqrt(-1 - x1**2)"}, "broken")
    with pytest.raises(WorkError, match="could be evaluated, too few"):
        run_study(broken, seed=0)


@pytest.mark.parametrize(
    ("dist", "skewness"), [("normal", 0.0), ("lognormal", 0.608), ("uniform", 0.0), ("gumbel", 1.1395)]
)
def test_random_variables_have_their_mean_scatter_and_shape(dist, skewness):
    content = LINEAR | {"random": [{"name": "a", "dist": dist, "mean": 5, "cov": 0.2}], "constraints": ["a"]}
    x = RandomSpace(parse_problem(content, "f")).physical(
        np.random.default_rng(0).standard_normal((400_000, 1)), np.zeros(0)
    )[:, 0]
    assert x.mean() == pytest.approx(5.0, abs=0.01)
    assert x.std() == pytest.approx(1.0, abs=0.01)
    assert np.mean((x - x.mean()) ** 3) / x.std() ** 3 == pytest.approx(skewness, abs=0.03)


def test_correlation_joins_the_variables_and_a_contradiction_is_refused():
    three = [{"name": n, "mean": 0, "std": 1} for n in "abc"]
    content = LINEAR | {"random": three, "constraints": ["a+b+c"]}
    space = RandomSpace(parse_problem(content | {"corr": [["a", "b", 0.8]]}, "f"))
    X = space.physical(np.random.default_rng(0).standard_normal((200_000, 3)), np.zeros(0))
    assert np.corrcoef(X.T)[0, 1] == pytest.approx(0.8, abs=0.01)
    assert np.corrcoef(X.T)[0, 2] == pytest.approx(0.0, abs=0.01)
    bad = content | {"corr": [["a", "b", 0.9], ["b", "c", 0.9], ["a", "c", -0.9]]}
    with pytest.raises(InputError, match="contradict each other"):
        RandomSpace(parse_problem(bad, "f"))


def test_worst_point_is_found_where_the_undamped_iteration_oscillates():
    # Concave: the gradient at the steepest point leads across, and back again.
    def g(U):
        return 3.0 - U[:, 0] - 0.4 * U[:, 1] ** 2

    angles = np.linspace(0.0, 2.0 * np.pi, 200_001)
    circle = 2.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    u, value = worst_point(g, 2.0, np.array([[1.0, 0.3], [1.0, -0.3]]))
    assert np.linalg.norm(u) == pytest.approx(2.0)
    assert value == pytest.approx(g(circle).min(), abs=1e-4)
