# SPDX-License-Identifier: Apache-2.0
"""How the controls of a wing study scatter around a design, and what fails because of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import InputError
from cwmav_rbdo.expressions import compile_function
from cwmav_rbdo.marginals import copula_factor, transformed
from cwmav_rbdo.noise import Noise
from cwmav_rbdo.reliability import Estimate, LimitState, certified, certified_estimate
from cwmav_rbdo.wing_problem import CONTROLS, WingProblem

Array = NDArray[np.float64]


class ControlScatter:
    """Scatter of the design variables of a study: how much, how distributed, how correlated.

    Standard deviations are everywhere the same or vary over the space; distributions have the design as
    mean. A correlation with a fixed control does not matter, because a fixed control is no variable.

    Attributes
    ----------
    constant : (d,) array or None
        Standard deviations where they are the same everywhere.
    normal : bool
        Whether the scatter is normal and independent, for which there are short cuts.
    """

    def __init__(self, noise: Noise, problem: WingProblem) -> None:
        self._names, self._fixed = problem.names, problem.fixed
        self._formulas = [
            compile_function(s.formula, CONTROLS, f"noise: {name}") if s.formula else None
            for name, s in ((name, noise.scatter[name]) for name in problem.names)
        ]
        self._std = np.array([noise.std(name) for name in problem.names])
        self.constant = self._std if not any(self._formulas) else None
        self._skewed = [
            (k, problem.distribution[name])
            for k, name in enumerate(problem.names)
            if problem.distribution.get(name, "normal") != "normal"
        ]
        both = [pair for pair in problem.corr if pair[0] in problem.names and pair[1] in problem.names]
        self._factor = copula_factor(problem.names, both)
        self.normal = not self._skewed and self._factor is None

    def __call__(self, X: Array) -> Array:
        """Give the standard deviations at designs (n, d); (n, d).

        Raises
        ------
        InputError
            A formula gives something that is no standard deviation.
        """
        X = np.atleast_2d(X)
        std = np.tile(self._std, (len(X), 1))
        if self.constant is not None:
            return std
        rows = {name: np.full(len(X), value) for name, value in self._fixed.items()}
        rows |= dict(zip(self._names, X.T, strict=True))
        for k, formula in enumerate(self._formulas):
            if formula is not None:
                std[:, k] = formula(rows)
        wrong = ~(np.isfinite(std) & (std >= 0.0))
        if np.any(wrong):
            row, k = np.argwhere(wrong)[0]
            raise InputError(
                f"noise: {self._names[k]} is {std[row, k]} at {X[row].tolist()}; "
                "allowed: standard deviations >= 0"
            )
        return std

    def around(self, X: Array, U: Array) -> Array:
        """Scatter designs X (n, d) by standard normal values U (n, d); (n, d)."""
        std = self(X)
        Z = U if self._factor is None else U @ self._factor.T
        scattered = X + std * Z
        for k, dist in self._skewed:
            scattered[:, k] = transformed(dist, self._names[k], X[:, k], std[:, k], Z[:, k])
        return np.asarray(scattered)

    def failure(
        self, g: LimitState, X: Array, order: int = 9, angles: int = 48, passed: Array | None = None
    ) -> tuple[Array, Array]:
        """Probability that `g` fails around designs, and its error; (n,) each.

        Parameters
        ----------
        g : limit state of rows (n, d + q)
        X : (n, d) designs
        order, angles : nodes of the quadratures
        passed : (n, q) columns that do not scatter and that `g` receives behind the controls
        """
        X = np.atleast_2d(X)
        passed = np.zeros((len(X), 0)) if passed is None else passed
        if self.normal:
            std = np.hstack([self(X), np.zeros_like(passed)])
            return certified(g, np.hstack([X, passed]), std, order, angles)
        designs, std = self._lifted(X, passed)
        return certified(self._of_standard(g, X.shape[1]), designs, std, order, angles)

    def estimate(self, g: LimitState, x: Array) -> Estimate:
        """Probability that `g` fails around one design (d,), with finer nodes."""
        if self.normal:
            return certified_estimate(g, x, self(x[None])[0])
        designs, std = self._lifted(x[None], np.zeros((1, 0)))
        return certified_estimate(self._of_standard(g, len(x)), designs[0], std)

    def spread(self, gradient: Array, X: Array) -> Array:
        """Propagate the scatter of designs X (n, d) through gradients (n, d) to first order; (n,)."""
        scaled = self(X) * gradient
        return np.asarray(np.linalg.norm(scaled if self._factor is None else scaled @ self._factor, axis=1))

    def _lifted(self, X: Array, passed: Array) -> tuple[Array, Array]:
        """Rows of design, what is passed on, and the standard normal variables, which alone scatter."""
        d = X.shape[1]
        scattering = np.any(self(X) > 0.0, axis=0)
        std = np.concatenate([np.zeros(d + passed.shape[1]), scattering * 1.0])
        return np.hstack([X, passed, np.zeros_like(X)]), std

    def _of_standard(self, g: LimitState, d: int) -> LimitState:
        def of_standard(P: Array) -> Array:
            return g(np.hstack([self.around(P[:, :d], P[:, -d:]), P[:, d:-d]]))

        return of_standard
