# SPDX-License-Identifier: Apache-2.0
"""The design space: names, units and bounds of the design variables (Eq. 7 of the paper)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cwmav_common.errors import InputError

Array = NDArray[np.float64]


def checked_bounds(lo: ArrayLike, hi: ArrayLike) -> tuple[Array, Array]:
    """Return bounds as float arrays.

    Raises
    ------
    InputError
        If they differ in length, are not finite, or a lower one is not below its upper one.
    """
    lower, upper = np.asarray(lo, dtype=np.float64), np.asarray(hi, dtype=np.float64)
    if lower.ndim != 1 or lower.shape != upper.shape or len(lower) == 0:
        raise InputError(f"bounds: shapes {lower.shape} and {upper.shape}, expected twice the same (d,)")
    for k, (low, high) in enumerate(zip(lower, upper, strict=True)):
        if not (np.isfinite(low) and np.isfinite(high) and low < high):
            raise InputError(f"bounds of variable {k}: [{low}, {high}]; both must be finite and lo < hi")
    return lower, upper


@dataclass(frozen=True)
class Variable:
    """One design variable."""

    name: str
    lo: float
    hi: float
    unit: str = ""


@dataclass(frozen=True)
class DesignSpace:
    """A box in the units of its variables.

    Examples
    --------
    >>> space = DesignSpace((Variable("F", 4.0, 30.0, "Hz"), Variable("AoA", -10.0, 60.0, "deg")))
    >>> space.scale([[17.0, 25.0]])
    array([[0.5, 0.5]])
    """

    variables: tuple[Variable, ...]

    def __post_init__(self) -> None:
        """Check names and bounds."""
        names = [variable.name for variable in self.variables]
        for name in names:
            if names.count(name) > 1:
                raise InputError(
                    f"design variable {name!r} is there {names.count(name)} times; names are unique"
                )
        checked_bounds(self.lo, self.hi)

    @property
    def dimension(self) -> int:
        """Number of variables d."""
        return len(self.variables)

    @property
    def names(self) -> tuple[str, ...]:
        """Names in order."""
        return tuple(variable.name for variable in self.variables)

    @property
    def lo(self) -> Array:
        """Lower bounds, (d,)."""
        return np.array([variable.lo for variable in self.variables], dtype=np.float64)

    @property
    def hi(self) -> Array:
        """Upper bounds, (d,)."""
        return np.array([variable.hi for variable in self.variables], dtype=np.float64)

    def scale(self, X: ArrayLike) -> Array:
        """Map points (n, d) from the units of the variables to [0, 1]."""
        return (np.asarray(X, dtype=np.float64) - self.lo) / (self.hi - self.lo)

    def unscale(self, Z: ArrayLike) -> Array:
        """Map points (n, d) from [0, 1] to the units of the variables."""
        return self.lo + np.asarray(Z, dtype=np.float64) * (self.hi - self.lo)

    def contains(self, X: ArrayLike) -> NDArray[np.bool_]:
        """Whether each point (n, d) is inside, bounds included; (n,)."""
        points = np.asarray(X, dtype=np.float64)
        inside: NDArray[np.bool_] = np.all((points >= self.lo) & (points <= self.hi), axis=-1)
        return inside

    def clip(self, X: ArrayLike) -> Array:
        """Move points outside to the nearest bound."""
        return np.clip(np.asarray(X, dtype=np.float64), self.lo, self.hi)
