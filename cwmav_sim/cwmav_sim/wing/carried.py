# SPDX-License-Identifier: Apache-2.0
"""Air that a wing carries along, taken implicitly within one step.

The air's load was computed with accelerations foreseen at the begin of the step. Where the structure turns
out to accelerate differently, the load changes by the carried air times the difference,

    f = f_air - (B/h) (w - w_foreseen),

with the rates w of the structure's unknowns, B the inertia of the carried air and h the step. Without this a
film lighter than the air it moves would be thrown to and fro by an ever growing load, however short the
step (Causin, Gerbeau & Nobile, CMAME 194 (2005) 4506).
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np

from cwmav_sim.wing.arithmetic import HOST, Arithmetic
from cwmav_sim.wing.load_loops import scaled, take_resistance
from cwmav_sim.wing.parts import Configuration
from cwmav_sim.wing.sheet import FloatArray, IntArray


@dataclass(frozen=True)
class Carried:
    """What the air's load was computed with.

    Attributes
    ----------
    mass : ndarray, shape (n,)
        Air that each node of the sheet carries along its normal [kg].
    normal : ndarray, shape (n, 3)
        Unit normals of the nodes.
    rate : ndarray, shape (rows, 3)
        Foreseen accelerations of the structure's unknowns [m/s2, rad/s2].
    """

    mass: FloatArray
    normal: FloatArray
    rate: FloatArray


class CarriedAir:
    """That load, and its tangent.

    Parameters
    ----------
    rows : ndarray, shape (m, r)
        Rows whose rates each block couples; no two blocks share one.
    """

    def __init__(self, rows: IntArray) -> None:
        self._arithmetic: Arithmetic = HOST
        self._rows = rows
        self._dofs = (3 * rows[:, :, None] + np.arange(3)).reshape(len(rows), -1)
        size = self._dofs.shape[1]
        self._blocks = np.zeros((len(rows), size, size))
        self._foreseen: FloatArray | None = None

    def brought(self, arithmetic: Arithmetic) -> CarriedAir:
        """Return the same blocks in the place of an arithmetic."""
        other = copy(self)
        other._arithmetic = arithmetic
        other._rows, other._blocks = arithmetic.brought(self._rows), arithmetic.brought(self._blocks)
        other._foreseen = None
        return other

    @property
    def dofs(self) -> IntArray:
        """Scalar unknowns of every block, shape (m, d), on the host."""
        return self._dofs

    def renew(self, blocks: FloatArray, foreseen: FloatArray) -> None:
        """Take over B/h, shape (m, d, d) [kg/s], and the foreseen rates at the end of the step (rows, 3)."""
        self._blocks, self._foreseen = blocks, foreseen

    def change(self, c: Configuration, load: FloatArray) -> None:
        """Add to a load (rows, 3) how it changes."""
        if self._foreseen is not None:
            self._arithmetic.run(
                take_resistance, len(self._dofs), self._blocks, self._rows, c, self._foreseen, load
            )

    def tangent(self, c: Configuration, rate: float, stressed: Configuration) -> FloatArray:
        """Return the derivative of the load, shape (m, d, d)."""
        out, flat = self._arithmetic.empty(*self._dofs.shape, self._dofs.shape[1]), self._arithmetic.flat
        values = flat(self._blocks)
        self._arithmetic.run(scaled, len(values), rate, values, flat(out))
        return out


def node_blocks(count: int) -> IntArray:
    """Rows of blocks of one position each, shape (count, 1)."""
    return np.arange(count, dtype=np.int64)[:, None]


def body_blocks(count: int) -> IntArray:
    """Rows of blocks of position and spin of one body each, shape (count, 2)."""
    position = node_blocks(count)
    return np.concatenate([position, position + count], axis=1)
