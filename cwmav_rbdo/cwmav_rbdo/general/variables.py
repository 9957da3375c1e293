# SPDX-License-Identifier: Apache-2.0
"""The random vector of a general problem: from independent standard normal variables and a design to rows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import InputError
from cwmav_rbdo.expressions import compile_function
from cwmav_rbdo.general_problem import GeneralProblem
from cwmav_rbdo.marginals import copula_factor, transformed
from cwmav_rbdo.space import checked_bounds

Array = NDArray[np.float64]
REACH = 4.0
"""Standard deviations of the random variables that the first samples cover."""


class RandomSpace:
    """Variables that the expensive functions see: the random ones, then the design variables used directly.

    Attributes
    ----------
    names : tuple of str
        Of those variables, in the order of the columns of :meth:`physical`.
    dimension : int
        Number of random variables m.
    """

    def __init__(self, problem: GeneralProblem) -> None:
        self._design = problem.names
        self._factor = copula_factor([v.name for v in problem.random], problem.corr)
        random = problem.random
        self._moved = [j for j, v in enumerate(random) if isinstance(v.mean, str)]
        self._source = [problem.names.index(str(random[j].mean)) for j in self._moved]
        self._mean = np.array([0.0 if isinstance(v.mean, str) else v.mean for v in random])
        self._fixed = np.array([v.std if isinstance(v.std, int | float) else 0.0 for v in random])
        self._relative = np.array([v.cov or 0.0 for v in random])
        self._formulas = [
            (j, v, compile_function(v.std, problem.names, f"random variable {v.name}: std"))
            for j, v in enumerate(random)
            if isinstance(v.std, str)
        ]
        self._skewed = [(j, v) for j, v in enumerate(random) if v.dist != "normal"]
        self._direct = [k for k, name in enumerate(problem.names) if name in _used_directly(problem)]
        self.dimension = len(problem.random)
        self.names = (*(v.name for v in problem.random), *(problem.names[k] for k in self._direct))

    def physical(self, U: Array, D: Array) -> Array:
        """Map standard normal points (n, m) at designs (n, d) or (d,) to physical rows (n, m + direct)."""
        return self.at(D)(U)

    def at(self, D: Array) -> Callable[[Array], Array]:
        """Give :meth:`physical` at fixed designs as a function of the standard normal points alone."""
        D = np.atleast_2d(D)
        mean = np.tile(self._mean, (len(D), 1))
        mean[:, self._moved] = D[:, self._source]
        std = self._std(mean, D)
        direct = D[:, self._direct]

        def mapped(U: Array) -> Array:
            Z = U if self._factor is None else U @ self._factor.T
            X = mean + std * Z
            for j, variable in self._skewed:
                X[:, j] = transformed(variable.dist, variable.name, mean[:, j], std[:, j], Z[:, j])
            if not self._direct:
                return X
            return np.hstack([X, np.broadcast_to(direct, (len(X), direct.shape[1]))])

        return mapped

    def box(self, lower: Array, upper: Array) -> tuple[Array, Array]:
        """Bounds of the physical rows: the design box widened by `REACH` standard deviations."""
        corners = [
            self.physical(self._standard(side * REACH), bound[None])[0]
            for side in (-1.0, 1.0)
            for bound in (lower, upper)
        ]
        return checked_bounds(np.min(corners, axis=0), np.max(corners, axis=0))

    def _std(self, mean: Array, D: Array) -> Array:
        """Give the standard deviations (n, m): fixed, proportional to the means, or formulas."""
        std: Array = self._fixed + self._relative * np.abs(mean)
        for j, variable, formula in self._formulas:
            std[:, j] = formula(dict(zip(self._design, D.T, strict=True)))
            wrong = ~(np.isfinite(std[:, j]) & (std[:, j] > 0.0))
            if np.any(wrong):
                raise InputError(
                    f"random variable {variable.name}: std '{variable.std}' gives {std[wrong, j][0]:g}; "
                    "allowed: numbers > 0"
                )
        return std

    def _standard(self, z: float) -> Array:
        """Give the standard normal point (1, m) that the copula maps to `z` in every variable."""
        level = np.full(self.dimension, z)
        return (level if self._factor is None else np.linalg.solve(self._factor, level))[None]


def evaluated_names(problem: GeneralProblem) -> tuple[str, ...]:
    """Names of the variables at which the expensive functions are evaluated, in order."""
    return problem.names if problem.kind == "global" else RandomSpace(problem).names


def _used_directly(problem: GeneralProblem) -> set[str]:
    """Design variables that the constraints see otherwise than as a mean; all, where that cannot be known."""
    functions = problem.functions
    used: set[str] = set()
    for function in (*functions.constraints, *(f for _, f in functions.lets)):
        if function.names is None:
            return set(problem.names)
        used |= set(function.names)
    return used & set(problem.names)
