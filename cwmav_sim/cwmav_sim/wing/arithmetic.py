# SPDX-License-Identifier: Apache-2.0
"""Where the arrays of a structure lie, and who runs the loops over its nodes, bodies and elements.

Every loop of the structure is a compiled function ``loop(first, last, ...)`` that does the items ``first`` to
``last - 1`` and writes to arrays it is given; no item reads what another one writes. So the processor runs a
loop over all items at once, and a graphics card runs the same function with one item a thread. What is
written over these loops serves both.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from cwmav_sim.wing.algebra import compiled
from cwmav_sim.wing.sheet import FloatArray

if TYPE_CHECKING:
    from cwmav_sim.wing.block_lu import BlockLU

Loop = Callable[..., None]
_Tuple = TypeVar("_Tuple", bound=tuple[Any, ...])


class Solvable(Protocol):
    """Factors of a matrix."""

    def solve(self, right: FloatArray) -> FloatArray:
        """Return the solution for a right-hand side of shape (n, 3)."""
        ...


class Arithmetic(Protocol):
    """Arrays in one place, and the loops over them; arrays of another place must be brought first."""

    def empty(self, *shape: int) -> FloatArray:
        """Return room for numbers."""
        ...

    def zeros(self, *shape: int) -> FloatArray:
        """Return zeros."""
        ...

    def brought(self, values: NDArray[Any]) -> Any:
        """Return an array of the host here; it must not be written to."""
        ...

    def on_host(self, values: Any) -> NDArray[Any]:
        """Return an array of this place on the host."""
        ...

    def flat(self, values: FloatArray) -> FloatArray:
        """Return the same numbers in one row."""
        ...

    def run(self, loop: Loop, count: int, *args: Any) -> None:
        """Run a loop for the items 0 to ``count - 1``."""
        ...

    def largest(self, *fields: FloatArray) -> tuple[float, ...]:
        """Return the largest absolute value of every field, not a number where one is not."""
        ...

    def total(self, values: FloatArray) -> float:
        """Return the sum of numbers, shape (n,), taken in an order that never changes."""
        ...

    def factors(self, lu: BlockLU, stored: FloatArray) -> Solvable:
        """Factorise the matrix with these stored entries; only the newest factors are kept.

        Raises
        ------
        RuntimeError
            The matrix is singular.
        """
        ...


def brought_tuple(arithmetic: Arithmetic, values: _Tuple) -> _Tuple:
    """Return a named tuple with its arrays in the place of an arithmetic."""
    members = (arithmetic.brought(v) if isinstance(v, np.ndarray) else v for v in values)
    return type(values)(*members)


class _Host:
    """Arithmetic on the processor with NumPy's arrays."""

    def empty(self, *shape: int) -> FloatArray:
        return np.empty(shape)

    def zeros(self, *shape: int) -> FloatArray:
        return np.zeros(shape)

    def brought(self, values: NDArray[Any]) -> Any:
        return values

    def on_host(self, values: Any) -> NDArray[Any]:
        return np.asarray(values)

    def flat(self, values: FloatArray) -> FloatArray:
        return values.reshape(-1)

    def run(self, loop: Loop, count: int, *args: Any) -> None:
        loop(0, count, *args)

    def largest(self, *fields: FloatArray) -> tuple[float, ...]:
        return tuple(_largest(field.reshape(-1)) for field in fields)

    def total(self, values: FloatArray) -> float:
        return _total(values)

    def factors(self, lu: BlockLU, stored: FloatArray) -> Solvable:
        return lu.factorised(stored)


HOST: Arithmetic = _Host()


@compiled
def _largest(values: FloatArray) -> float:
    most = 0.0
    for value in values:
        if math.isnan(value):
            return math.nan
        most = max(most, abs(value))
    return most


@compiled
def _total(values: FloatArray) -> float:
    total = 0.0
    for value in values:
        total += value
    return total
