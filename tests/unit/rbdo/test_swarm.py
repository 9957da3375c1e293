# SPDX-License-Identifier: Apache-2.0
"""Particle swarm: Table 4 preset, pitfalls of the library, repeatability."""

import logging

import numpy as np
import pytest

from cwmav_common.errors import InputError, WorkError
from cwmav_rbdo.swarm import PyswarmsSwarm, SwarmSettings

SMALL = SwarmSettings(particles=60, iterations=150)


def bowl(X):
    return np.sum((X - [0.3, -0.2]) ** 2, axis=1)


def test_defaults_are_table_4():
    s = SwarmSettings()
    assert (s.particles, s.iterations, s.inertia_start, s.inertia_end) == (1000, 1000, 0.9, 0.4)
    assert (s.cognitive, s.social, s.patience) == (2.0, 2.0, 0)


def test_table_4_runs_all_iterations_with_falling_inertia(monkeypatch):
    # The library sets up its log file when it is imported; after a first swarm it has been, under guard.
    PyswarmsSwarm(SMALL).minimise(bowl, [-1, -1], [1, 1], np.random.default_rng(0))
    from pyswarms.backend import operators

    seen = []
    original = operators.compute_velocity

    def spy(swarm, *arguments, **more):
        seen.append(dict(swarm.options))
        return original(swarm, *arguments, **more)

    monkeypatch.setattr(operators, "compute_velocity", spy)
    result = PyswarmsSwarm().minimise(bowl, [-1, -1], [1, 1], np.random.default_rng(0))
    assert len(result.history) == 1000
    assert result.evaluations == 1_000_000
    assert seen[0]["w"] == pytest.approx(0.9)
    assert seen[-1]["w"] == pytest.approx(0.4, abs=1e-3)
    assert {(o["c1"], o["c2"]) for o in seen} == {(2.0, 2.0)}
    assert np.allclose(result.x, [0.3, -0.2], atol=1e-6)


def test_finds_an_optimum_in_the_corner_exactly():
    result = PyswarmsSwarm(SMALL).minimise(
        lambda X: -X.sum(axis=1), [0, -4], [2, 6], np.random.default_rng(1)
    )
    assert np.array_equal(result.x, [2.0, 6.0])
    assert result.f == -8.0


def test_every_point_tried_is_inside():
    def watched(X):
        assert np.all(X >= [-1.0, 2.0])
        assert np.all(X <= [1.0, 2.5])
        return np.sin(9 * X[:, 0]) + X[:, 1]

    PyswarmsSwarm(SMALL).minimise(watched, [-1, 2], [1, 2.5], np.random.default_rng(3))


def test_history_never_rises_and_best_belongs_to_x():
    def rugged(X):
        return np.sum(X**2 - np.cos(12 * X), axis=1)

    result = PyswarmsSwarm(SMALL).minimise(rugged, [-3, -3], [3, 3], np.random.default_rng(2))
    assert np.all(np.diff(result.history) <= 0)
    assert rugged(result.x[None])[0] == result.f == result.history[-1]


def test_same_seed_same_bits_and_global_state_untouched():
    np.random.seed(123)  # noqa: NPY002
    expected = np.random.default_rng(5)
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    a = PyswarmsSwarm(SMALL).minimise(bowl, [-1, -1], [1, 1], np.random.default_rng(5))
    assert np.array_equal(np.random.get_state()[1], before)  # noqa: NPY002
    np.random.seed(9)  # noqa: NPY002
    b = PyswarmsSwarm(SMALL).minimise(bowl, [-1, -1], [1, 1], expected)
    assert np.array_equal(a.x, b.x)
    assert np.array_equal(a.history, b.history)


def test_leaves_no_log_file_and_no_handlers(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    handlers = list(logging.getLogger().handlers)
    PyswarmsSwarm(SMALL).minimise(bowl, [-1, -1], [1, 1], np.random.default_rng(0))
    assert list(tmp_path.iterdir()) == []
    assert logging.getLogger().handlers == handlers


def test_patience_ends_early():
    settings = SwarmSettings(particles=60, iterations=1000, patience=20, tolerance=1e-6)
    result = PyswarmsSwarm(settings).minimise(bowl, [-1, -1], [1, 1], np.random.default_rng(0))
    assert len(result.history) < 400
    assert np.allclose(result.x, [0.3, -0.2], atol=1e-2)


def test_start_points_are_used():
    settings = SwarmSettings(particles=5, iterations=1)
    result = PyswarmsSwarm(settings).minimise(
        bowl, [-1, -1], [1, 1], np.random.default_rng(0), start=np.array([[0.3, -0.2]])
    )
    assert result.f == 0.0


def test_nan_is_never_best_and_only_nan_is_an_error():
    def partly(X):
        return np.where(X[:, 0] > 0, np.nan, X[:, 0] ** 2)

    result = PyswarmsSwarm(SMALL).minimise(partly, [-1, -1], [1, 1], np.random.default_rng(0))
    assert result.x[0] <= 0
    with pytest.raises(WorkError, match="finite at none of the 60"):
        PyswarmsSwarm(SMALL).minimise(lambda X: np.full(len(X), np.nan), [0], [1], np.random.default_rng(0))


@pytest.mark.parametrize(("lo", "hi"), [([0, 1], [1, 1]), ([0], [np.inf]), ([0], [1, 2])])
def test_wrong_bounds_are_refused(lo, hi):
    with pytest.raises(InputError, match="bounds"):
        PyswarmsSwarm(SMALL).minimise(bowl, lo, hi, np.random.default_rng(0))
