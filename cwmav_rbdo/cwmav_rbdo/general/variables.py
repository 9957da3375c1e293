# SPDX-License-Identifier: Apache-2.0
"""The random vector of a general problem: from independent standard normal variables and a design to rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from cwmav_common.errors import InputError
from cwmav_rbdo.expressions import compile_function
from cwmav_rbdo.general_problem import GeneralProblem, RandomVariable
from cwmav_rbdo.space import checked_bounds

Array = NDArray[np.float64]
_EULER = 0.5772156649015329
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
        self._random = problem.random
        self._design = problem.names
        self._factor = _copula_factor(problem)
        self._spread = [
            compile_function(v.std, problem.names, f"random variable {v.name}: std")
            if isinstance(v.std, str)
            else None
            for v in problem.random
        ]
        self._direct = [k for k, name in enumerate(problem.names) if name in _used_directly(problem)]
        self.dimension = len(problem.random)
        self.names = (*(v.name for v in problem.random), *(problem.names[k] for k in self._direct))

    def physical(self, U: Array, D: Array) -> Array:
        """Map standard normal points (n, m) at designs (n, d) or (d,) to physical rows (n, m + direct)."""
        D = np.broadcast_to(D, (len(U), D.shape[-1]))
        Z = U if self._factor is None else U @ self._factor.T
        columns = []
        for k, variable in enumerate(self._random):
            mean = (
                D[:, self._design.index(variable.mean)]
                if isinstance(variable.mean, str)
                else np.full(len(U), variable.mean)
            )
            columns.append(_transformed(variable, mean, self._std(k, mean, D), Z[:, k]))
        return np.column_stack([*columns, *(D[:, k] for k in self._direct)])

    def box(self, lower: Array, upper: Array) -> tuple[Array, Array]:
        """Bounds of the physical rows: the design box widened by `REACH` standard deviations."""
        corners = [
            self.physical(self._standard(side * REACH), bound[None])[0]
            for side in (-1.0, 1.0)
            for bound in (lower, upper)
        ]
        return checked_bounds(np.min(corners, axis=0), np.max(corners, axis=0))

    def _std(self, k: int, mean: Array, D: Array) -> Array:
        """Give the standard deviation of variable `k`: fixed, proportional to the mean, or a formula."""
        variable, formula = self._random[k], self._spread[k]
        if formula is not None:
            std = formula(dict(zip(self._design, D.T, strict=True)))
            if not np.all(np.isfinite(std) & (std > 0.0)):
                raise InputError(
                    f"random variable {variable.name}: std '{variable.std}' gives {std[~(std > 0.0)][0]:g}; "
                    "allowed: numbers > 0"
                )
            return std
        if isinstance(variable.std, int | float):
            return np.full_like(mean, variable.std)
        return np.abs(mean) * (variable.cov or 0.0)

    def _standard(self, z: float) -> Array:
        """Give the standard normal point (1, m) that the copula maps to `z` in every variable."""
        level = np.full(self.dimension, z)
        return (level if self._factor is None else np.linalg.solve(self._factor, level))[None]


def evaluated_names(problem: GeneralProblem) -> tuple[str, ...]:
    """Names of the variables at which the expensive functions are evaluated, in order."""
    return problem.names if problem.kind == "global" else RandomSpace(problem).names


def _transformed(variable: RandomVariable, mean: Array, std: Array, z: Array) -> Array:
    if variable.dist == "normal":
        return mean + std * z
    if variable.dist == "lognormal":
        if np.any(mean <= 0.0):
            raise InputError(
                f"random variable {variable.name}: a lognormal mean must be > 0, got {mean.min():g}"
            )
        zeta2 = np.log1p((std / mean) ** 2)
        return np.asarray(np.exp(np.log(mean) - 0.5 * zeta2 + np.sqrt(zeta2) * z))
    if variable.dist == "uniform":
        return np.asarray(mean + np.sqrt(3.0) * std * (2.0 * ndtr(z) - 1.0))
    scale = std * np.sqrt(6.0) / np.pi  # Gumbel, largest values
    return np.asarray(mean - _EULER * scale - scale * np.log(-np.log(np.clip(ndtr(z), 1e-300, 1.0 - 1e-16))))


def _copula_factor(problem: GeneralProblem) -> Array | None:
    if not problem.corr:
        return None
    names = [v.name for v in problem.random]
    C = np.eye(len(names))
    for a, b, rho in problem.corr:
        C[names.index(a), names.index(b)] = C[names.index(b), names.index(a)] = rho
    try:
        return np.asarray(np.linalg.cholesky(C))
    except np.linalg.LinAlgError:
        least = np.linalg.eigvalsh(C)[0]
        raise InputError(
            f"corr: the correlations contradict each other (least eigenvalue {least:.3g})"
        ) from None


def _used_directly(problem: GeneralProblem) -> set[str]:
    """Design variables that the constraints see otherwise than as a mean; all, where that cannot be known."""
    functions = problem.functions
    used: set[str] = set()
    for function in (*functions.constraints, *(f for _, f in functions.lets)):
        if function.names is None:
            return set(problem.names)
        used |= set(function.names)
    return used & set(problem.names)
