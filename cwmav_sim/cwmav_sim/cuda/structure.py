# SPDX-License-Identifier: Apache-2.0
"""The structure of the wings on the card: arrays, loops with an item a thread, and numbers for the host.

The loops themselves are those of the processor (:mod:`cwmav_sim.wing.arithmetic`); the compiler makes them
anew for the card. A step of the structure starts some three hundred of them, so arrays are not returned to
the driver: room that nobody holds any more serves again. That is safe without waiting, because all work is
done in the order in which it was started.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from types import FunctionType
from typing import Any

import numba as nb
import numpy as np
from numba import cuda
from numpy.typing import NDArray

from cwmav_sim.cuda.block_lu import CardLU
from cwmav_sim.cuda.launch import MANY_THREADS, CardArray, Mail, clear, empty, launch, reshaped, start_blocks
from cwmav_sim.cuda.scan import reduce_blocks
from cwmav_sim.wing.arithmetic import Loop
from cwmav_sim.wing.block_lu import BlockLU

_FIELDS = 4  # whose largest values are asked for at once, at most


def _references(items: Sequence[Any]) -> list[int]:
    """Count who refers to each item, the sequence and the question included."""
    return [sys.getrefcount(item) for item in items]


_UNHELD = _references([object()])[0]  # of an item that only a sequence holds


def _item(count, args):
    i = cuda.grid(1)
    if i < count:
        loop(i, i + 1, *args)  # type: ignore[name-defined]  # noqa: F821 - every copy has its own


@cache
def kernel_of(loop: Loop) -> Any:
    """Return the kernel that runs a compiled loop with one item a thread.

    It is a copy of one function that knows its loop by a global name: what the compiler made of a function is
    kept on disk under the function's name, but never found again for one that was made within another.
    """
    name = loop.__name__
    function = FunctionType(_item.__code__.replace(co_name=name), {**globals(), "loop": loop}, name)
    function.__qualname__ = f"{loop.__module__}.{name}"
    return cuda.jit(cache=True)(function)


@dataclass(frozen=True)
class _CardFactors:
    lu: CardLU
    arithmetic: CardArithmetic

    def solve(self, right: CardArray) -> CardArray:
        out = self.arithmetic.empty(*right.shape)
        self.lu.solve(right, out)
        return out


class CardArithmetic:
    """Arrays and loops of a structure on the card, as :mod:`cwmav_sim.wing.arithmetic` wants them."""

    def __init__(self) -> None:
        self._pool: dict[tuple[tuple[int, ...], np.dtype], list[CardArray]] = {}
        self._mail = Mail()
        self._found = empty(_FIELDS)
        self._lu: tuple[BlockLU, CardLU] | None = None

    def empty(self, *shape: int) -> CardArray:
        """Return room for numbers, with undefined content."""
        return self._room(tuple(shape), np.dtype(np.float64))

    def _room(self, shape: tuple[int, ...], dtype: np.dtype) -> CardArray:
        pool = self._pool.setdefault((shape, dtype), [])
        for number, references in enumerate(_references(pool)):
            if references == _UNHELD:
                return pool[number]
        pool.append(empty(shape, dtype))
        return pool[-1]

    def zeros(self, *shape: int) -> CardArray:
        """Return zeros."""
        out = self.empty(*shape)
        clear(self.flat(out))
        return out

    def brought(self, values: NDArray[Any]) -> CardArray:
        """Return a copy of an array of the host."""
        out = self._room(values.shape, values.dtype)
        self._mail.send(np.ascontiguousarray(values), out)
        return out

    def on_host(self, values: CardArray) -> NDArray[Any]:
        """Return a copy on the host."""
        return np.asarray(values.copy_to_host())

    def flat(self, values: CardArray) -> CardArray:
        """Return the same numbers in one row; the array itself must be held as long as the row is used."""
        if values.ndim == 1:
            return values
        return _seen_as(values, "row", values.size)

    def run(self, loop: Loop, count: int, *args: Any) -> None:
        """Start a loop for the items 0 to ``count - 1``."""
        if count:
            launch(kernel_of(loop), count, count, args)

    def largest(self, *fields: CardArray) -> tuple[float, ...]:
        """Return the largest absolute value of every field, not a number where one is not."""
        rows = tuple(self.flat(field) for field in fields)
        padded = (*rows, *[rows[0]] * (_FIELDS - len(rows)))
        start_blocks(_largest, len(rows), padded, self._found, threads=MANY_THREADS)
        return tuple(self._found.copy_to_host()[: len(rows)].tolist())

    def total(self, values: CardArray) -> float:
        """Return the sum of numbers, shape (n,), taken in an order that never changes."""
        reduce_blocks(_seen_as(values, "table", 1, values.size), 0, self._found, 0)
        return float(self._found.copy_to_host()[0])

    def factors(self, lu: BlockLU, stored: CardArray) -> _CardFactors:
        """Factorise the matrix with these stored entries; only the newest factors are kept.

        Raises
        ------
        RuntimeError
            The matrix is singular.
        """
        if self._lu is None or self._lu[0] is not lu:
            self._lu = lu, CardLU(lu)
        card = self._lu[1]
        card.factorise(stored)
        return _CardFactors(card, self)


def _seen_as(values: CardArray, name: str, *shape: int) -> CardArray:
    """Return an array in another shape, kept with it under a name."""
    found = vars(values).get(name)
    if found is None:
        found = reshaped(values, *shape)
        setattr(values, name, found)
    return found


@cuda.jit(cache=True)
def _largest(fields, out):
    """Find the largest absolute value of a field, one block each; a number that is none stays."""
    part = cuda.shared.array(MANY_THREADS, nb.float64)
    t, k = cuda.threadIdx.x, cuda.blockIdx.x
    values = fields[k]
    found = 0.0
    for i in range(t, values.shape[0], MANY_THREADS):
        found = _larger(found, abs(values[i]))
    part[t] = found
    cuda.syncthreads()
    if t == 0:
        for q in range(MANY_THREADS):
            found = _larger(found, part[q])
        out[k] = found


@cuda.jit(device=True)
def _larger(found, value):
    """Return the larger of two numbers, or the one that is none."""
    return value if found == found and not value <= found else found
