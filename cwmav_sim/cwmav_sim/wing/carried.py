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

from dataclasses import dataclass

import numpy as np

from cwmav_sim.wing.algebra import compiled
from cwmav_sim.wing.dynamics import Configuration
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
    """Tangent of that load, as an element that resists nothing by itself.

    Parameters
    ----------
    dofs : ndarray, shape (m, d)
        Scalar unknowns of every block.
    """

    def __init__(self, dofs: IntArray) -> None:
        self._dofs = dofs
        self._blocks = np.zeros((*dofs.shape, dofs.shape[1]))
        self._foreseen: FloatArray | None = None

    @property
    def dofs(self) -> IntArray:
        """Scalar unknowns of every block, shape (m, d)."""
        return self._dofs

    def renew(self, blocks: FloatArray, foreseen: FloatArray) -> None:
        """Take over B/h, shape (m, d, d) [kg/s], and the foreseen rates at the end of the step (rows, 3)."""
        self._blocks, self._foreseen = blocks, foreseen

    def load(self, c: Configuration) -> FloatArray:
        """Return the change of the load, shape (rows, 3)."""
        rates = c.rates
        if self._foreseen is None:
            return np.zeros_like(rates)
        missed = (rates - self._foreseen).ravel()
        return _resistance(self._blocks, self._dofs, missed).reshape(-1, 3)

    def forces(self, c: Configuration) -> FloatArray:
        """Return zero: the force is a load."""
        return np.zeros(self._dofs.shape)

    def tangent(self, c: Configuration, rate: float, stressed: Configuration) -> FloatArray:
        """Return the derivative of the load, shape (m, d, d)."""
        return rate * self._blocks

    def energy(self, c: Configuration) -> float:
        """Return zero."""
        return 0.0

    def dissipation(self, c: Configuration) -> float:
        """Return zero."""
        return 0.0


@compiled
def _resistance(blocks: FloatArray, dofs: IntArray, rates: FloatArray) -> FloatArray:
    """Return minus the blocks (m, d, d) times the rates of their unknowns, summed over the blocks."""
    out = np.zeros(len(rates))
    for m in range(dofs.shape[0]):
        for i in range(dofs.shape[1]):
            for j in range(dofs.shape[1]):
                out[dofs[m, i]] -= blocks[m, i, j] * rates[dofs[m, j]]
    return out


def node_blocks(count: int) -> IntArray:
    """Unknowns of blocks of one position each, shape (count, 3)."""
    return np.arange(3 * count, dtype=np.int64).reshape(-1, 3)


def body_blocks(count: int) -> IntArray:
    """Unknowns of blocks of position and spin of one body each, shape (count, 6)."""
    position = node_blocks(count)
    return np.concatenate([position, position + 3 * count], axis=1)
