# SPDX-License-Identifier: Apache-2.0
"""Constraints whose values run over many orders of magnitude."""

import numpy as np
import pytest
import yaml
from scipy.special import ndtri

from cwmav_rbdo.general.surrogates import Surrogates
from cwmav_rbdo.general.variables import RandomSpace
from cwmav_rbdo.kriging import Kriging
from cwmav_rbdo.problem import parse_problem
from cwmav_rbdo.sampling import latin_hypercube
from cwmav_rbdo.study import run_study
from cwmav_rbdo.wing_problem import SurrogateSettings

LOW, HIGH = np.full(2, 0.003), np.full(2, 3.0)

# Ragsdell and Phillips (1976), J. Eng. Ind. 98:1021, in the form with scatter that methods are compared on.
WELDED_BEAM = """
id: welded_beam
kind: rbdo
design:
  - {name: d1, lo: 3.175, hi: 50.8}
  - {name: d2, lo: 0.1, hi: 254}
  - {name: d3, lo: 0.1, hi: 254}
  - {name: d4, lo: 3.175, hi: 50.8}
random:
  - {name: x1, mean: d1, std: 0.1693}
  - {name: x2, mean: d2, std: 0.1693}
  - {name: x3, mean: d3, std: 0.0107}
  - {name: x4, mean: d4, std: 0.0107}
let:
  - [M, "26688*(355.6 + x2/2)"]
  - [R, "sqrt(x2**2 + (x1+x3)**2)/2"]
  - [J, "sqrt(2)*x1*x2*(x2**2/12 + (x1+x3)**2/4)"]
  - [t1, "26688/(sqrt(2)*x1*x2)"]
  - [t2, "M*R/J"]
  - [shear, "sqrt(t1**2 + t1*t2*x2/R + t2**2)"]
  - [bending, "6*26688*355.6/(x3**2*x4)"]
  - [tip, "4*26688*355.6**3/(2.0685e5*x3**3*x4)"]
  - [load, "4.013*x3*x4**3*sqrt(2.0685e5*8.274e4)/(6*355.6**2)*(1 - x3/(4*355.6)*sqrt(2.0685e5/8.274e4))"]
objective: "6.74135e-5*d1**2*d2 + 2.93585e-6*d3*d4*(355.6 + d2)"
constraints: ["1 - shear/93.77", "1 - bending/206.85", "1 - x1/x4", "1 - tip/6.35", "load/26688 - 1"]
beta_target: 3
max_true_evaluations: 120
"""


def responses(X):
    return np.column_stack([1.0 - 1.0 / (X[:, 0] * X[:, 1]) ** 1.5, 2.0 - X.sum(axis=1)])


def test_long_tails_are_compressed_and_signs_kept():
    X = latin_hypercube(40, LOW, HIGH, np.random.default_rng(0))
    X[0] = [0.01, 0.2]  # some ten thousand times the usual magnitude
    Y = responses(X)
    found = Surrogates(SurrogateSettings(), X[:30], Y[:30])
    assert np.array_equal(found.Y[:, 1], Y[:30, 1])
    assert np.abs(found.Y[:, 0]).max() < 20.0 < 1e3 < np.abs(Y[:, 0]).max()
    found.add(X[30:33], Y[30:33])
    found.add(X[33:], Y[33:])
    assert found.Y.shape == Y.shape
    assert np.array_equal(found.Y > 0.0, Y > 0.0)
    new = np.random.default_rng(1).uniform(0.1, 3.0, (5000, 2))
    wrong = [np.mean((found.mean(k, new) > 0.0) != (responses(new)[:, k] > 0.0)) for k in (0, 1)]
    assert max(wrong) < 0.03
    plain = Kriging().fit(X, Y[:, 0]).predict(new)
    assert np.mean((plain > 0.0) != (responses(new)[:, 0] > 0.0)) > 5.0 * max(wrong)


def test_a_tail_that_is_found_late_is_compressed_then():
    X = latin_hypercube(24, np.full(2, 0.5), HIGH, np.random.default_rng(0))
    found = Surrogates(SurrogateSettings(), X, responses(X))
    assert np.array_equal(found.Y, responses(X))
    late = np.array([[0.01, 0.2], [0.02, 0.1], [0.3, 0.01], [0.2, 0.2]])
    found.add(late, responses(late))
    assert np.abs(found.Y[:, 0]).max() < 20.0
    assert np.array_equal(found.Y > 0.0, responses(np.vstack([X, late])) > 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_welded_beam_is_solved(seed):
    problem = parse_problem(yaml.safe_load(WELDED_BEAM), "welded_beam")
    result = run_study(problem, seed=seed)
    assert result.converged
    assert result.objective == pytest.approx(2.5913, rel=1e-3)
    assert result.true_evaluations < 90
    space = RandomSpace(problem)
    X = space.physical(
        np.random.default_rng(5).standard_normal((400_000, 4)), np.array([*result.design.values()])
    )
    g = problem.functions.limit_states(dict(zip(space.names, X.T, strict=True)))
    assert np.all(-ndtri(np.maximum((g <= 0).mean(axis=0), 1e-9)) > 2.95)
