# SPDX-License-Identifier: Apache-2.0
"""Particle swarm optimisation behind a small protocol; the default settings are Table 4 of the paper.

The swarm itself is pyswarms' (operators, topology, boundary and option handlers); the loop is ours, because
the library's own has properties that matter here: its default ``periodic`` bounds miss an optimum on a
bound, the final inertia cannot be set, all positions of all iterations stay in memory, and it ends only on
the change of the best value between two iterations. Its random numbers come from numpy's global state,
which is seeded from our generator and put back; its logging set-up, which would create a ``report.log``, is
held off.
"""

from __future__ import annotations

import logging.config
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cwmav_common.errors import InputError, WorkError
from cwmav_common.settings import setting
from cwmav_rbdo.plugins import resolve
from cwmav_rbdo.space import checked_bounds

Array = NDArray[np.float64]
Objective = Callable[[Array], Array]
"""Vectorised objective: points (n, d) -> values (n,), minimised. NaN counts as infinitely bad."""

_GLOBAL_STATE = threading.RLock()


@dataclass(frozen=True)
class SwarmSettings:
    """Settings of the particle swarm; the defaults are Table 4 of the paper."""

    particles: int = setting(1000, "number of particles (Table 4: number of swarms)", ge=2, le=1_000_000)
    iterations: int = setting(1000, "iterations at most", ge=1, le=1_000_000)
    inertia_start: float = setting(0.9, "inertia weight of the first iteration", ge=0, le=2)
    inertia_end: float = setting(0.4, "inertia weight that the last iteration tends to", ge=0, le=2)
    cognitive: float = setting(2.0, "acceleration towards the particle's own best", ge=0, le=4)
    social: float = setting(2.0, "acceleration towards the swarm's best", ge=0, le=4)
    velocity_limit: float = setting(
        0.2, "largest step per iteration, as a fraction of the range; 0: no limit", ge=0, le=1
    )
    patience: int = setting(
        0, "end after this many iterations without progress; 0: run all of them, as in the paper", ge=0
    )
    tolerance: float = setting(
        1e-9, "progress is a decrease of more than this, relative to the spread of the first values", ge=0
    )


@dataclass(frozen=True)
class SwarmResult:
    """Best point found, its value, and the best value after each iteration."""

    x: Array
    """(d,)"""
    f: float
    history: Array
    """(iterations done,)"""
    evaluations: int


class Swarm(Protocol):
    """Anything that minimises a vectorised function in a box."""

    def minimise(
        self, f: Objective, lo: ArrayLike, hi: ArrayLike, rng: np.random.Generator, start: Array | None = None
    ) -> SwarmResult:
        """Minimise `f` over ``lo <= x <= hi``; `start` (k, d) are points to include in the first swarm."""
        ...


def swarm_of(name: str, settings: SwarmSettings) -> Swarm:
    """Give the optimiser of a name: ``pyswarms``, or the user's own, called with the settings."""
    known: Mapping[str, Callable[[SwarmSettings], Swarm]] = {"pyswarms": PyswarmsSwarm}
    return resolve(name, known, "optimiser")(settings)


class PyswarmsSwarm:
    """Global-best particle swarm with the operators of pyswarms.

    Particles that leave the box are put on the nearest bound and their velocity component there is set to
    zero.

    Examples
    --------
    >>> swarm = PyswarmsSwarm(SwarmSettings(particles=50, iterations=200))
    >>> rng = np.random.default_rng(1)
    >>> result = swarm.minimise(lambda X: ((X - 0.3) ** 2).sum(axis=1), [0, 0], [1, 1], rng)
    >>> bool(np.allclose(result.x, 0.3, atol=1e-3))
    True
    """

    def __init__(self, settings: SwarmSettings | None = None) -> None:
        self.settings = settings or SwarmSettings()

    def minimise(
        self, f: Objective, lo: ArrayLike, hi: ArrayLike, rng: np.random.Generator, start: Array | None = None
    ) -> SwarmResult:
        """Minimise `f` over the box.

        Parameters
        ----------
        f : callable
            Points (n, d) -> values (n,).
        lo, hi : (d,) arrays
            Bounds.
        rng : numpy.random.Generator
            The only source of randomness.
        start : (k, d) array, optional
            Points put into the first swarm, k at most the number of particles; moved into the box if outside.

        Raises
        ------
        InputError
            On wrong bounds or start points.
        WorkError
            If the objective is finite nowhere in the first swarm.
        """
        lower, upper = checked_bounds(lo, hi)
        position = lower + (upper - lower) * rng.random((self.settings.particles, len(lower)))
        if start is not None:
            first = np.atleast_2d(np.asarray(start, dtype=np.float64))
            if first.shape[1] != len(lower) or len(first) > len(position):
                raise InputError(
                    f"start: shape {first.shape}, allowed at most ({len(position)}, {len(lower)})"
                )
            position[: len(first)] = np.clip(first, lower, upper)
        with _contained(rng):
            return self._run(f, lower, upper, position)

    def _run(self, f: Objective, lower: Array, upper: Array, position: Array) -> SwarmResult:
        from pyswarms.backend import handlers, operators
        from pyswarms.backend.swarms import Swarm as State
        from pyswarms.backend.topology import Star

        s = self.settings
        limit = s.velocity_limit * (upper - lower)
        clamp = (-limit, limit) if s.velocity_limit else None
        nearest, unmodified = handlers.BoundaryHandler("nearest"), handlers.VelocityHandler("unmodified")
        # Only "w" may be listed: the handler would shrink c1 and c2 without being asked.
        inertia = handlers.OptionsHandler({"w": "lin_variation"})
        options: dict[str, Any] = {"c1": s.cognitive, "c2": s.social, "w": s.inertia_start}
        swarm = State(position=position, velocity=np.zeros_like(position), options=dict(options))
        swarm.pbest_cost = np.full(len(position), np.inf)
        topology, stale, progress = Star(), 0, 0.0
        history: list[float] = []
        for iteration in range(s.iterations):
            swarm.current_cost = _values(f, swarm.position)
            swarm.pbest_pos, swarm.pbest_cost = operators.compute_pbest(swarm)
            swarm.best_pos, swarm.best_cost = topology.compute_gbest(swarm)
            if iteration == 0:
                finite = swarm.current_cost[np.isfinite(swarm.current_cost)]
                if len(finite) == 0:
                    raise WorkError(
                        f"swarm: the objective is finite at none of the {len(position)} first points"
                    )
                progress = s.tolerance * float(np.ptp(finite))
            improved = not history or float(swarm.best_cost) < history[-1] - progress
            stale = 0 if improved else stale + 1
            history.append(float(swarm.best_cost))
            if s.patience and stale >= s.patience:
                break
            swarm.options = inertia(
                options, iternow=iteration, itermax=s.iterations, end_opts={"w": s.inertia_end}
            )
            swarm.velocity = operators.compute_velocity(swarm, clamp, unmodified)
            free = swarm.position + swarm.velocity
            swarm.position = operators.compute_position(swarm, (lower, upper), nearest)
            swarm.velocity = np.where(swarm.position == free, swarm.velocity, 0.0)
        best = int(np.argmin(swarm.pbest_cost))
        return SwarmResult(
            swarm.pbest_pos[best].copy(), history[-1], np.array(history), len(history) * len(position)
        )


def _values(f: Objective, X: Array) -> Array:
    values = np.asarray(f(X), dtype=np.float64)
    if values.shape != (len(X),):
        raise InputError(
            f"objective: returned shape {values.shape} for {len(X)} points, expected ({len(X)},)"
        )
    return np.where(np.isnan(values), np.inf, values)


@contextmanager
def _contained(rng: np.random.Generator) -> Iterator[None]:
    """Seed numpy's global state for pyswarms and put it back; keep the library from logging to a file."""
    with _GLOBAL_STATE:
        state, configure = np.random.get_state(), logging.config.dictConfig  # noqa: NPY002
        # Every reporter of the library calls dictConfig with a handler that opens report.log.
        logging.config.dictConfig = lambda config: None
        try:
            np.random.seed(rng.integers(2**32, dtype=np.uint32))  # noqa: NPY002
            yield
        finally:
            np.random.set_state(state)  # noqa: NPY002
            logging.config.dictConfig = configure
