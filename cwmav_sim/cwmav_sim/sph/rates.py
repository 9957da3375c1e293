# SPDX-License-Identifier: Apache-2.0
"""What one pass over the particles gives: rates of change, loads on the walls, sides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cwmav_sim.sph.surfaces import Sides

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Rates:
    """What one pass gives, in the storage order of the particles.

    Attributes
    ----------
    acceleration : ndarray, shape (n, 3)
        [m/s2].
    density_rate : ndarray, shape (n,)
        [kg/(m3 s)].
    concentration_gradient : ndarray, shape (n, 3)
        Gradient of the particle concentration [1/m]; zero without shifting.
    pressure, viscous : ndarray, shape (panels, 3)
        Forces of the air on every panel [N].
    power : ndarray, shape (panels,)
        Power every panel gives to the air [W].
    moment : ndarray, shape (panels, 3)
        Moment of the air on every panel about the origin [N m].
    sides : Sides
        Where the particles lie with respect to the walls, mirror images left out.
    reaction : ndarray, shape (4, elements), or None
        Force of the air on every wall element [N] and the mass of air that it carries along [kg]; only where
        asked for.
    """

    acceleration: FloatArray
    density_rate: FloatArray
    concentration_gradient: FloatArray
    pressure: FloatArray
    viscous: FloatArray
    power: FloatArray
    moment: FloatArray
    sides: Sides
    reaction: FloatArray | None = None


def as_rates(
    acceleration: FloatArray, density_rate: FloatArray, shift: FloatArray, loads: FloatArray, sides: Sides
) -> Rates:
    """Return what a pass filled, with the wall loads, shape (panels, 11), taken apart."""
    return Rates(
        acceleration=acceleration,
        density_rate=density_rate,
        concentration_gradient=shift,
        pressure=loads[:, 0:3],
        viscous=loads[:, 3:6],
        power=-(loads[:, 6] + loads[:, 7]),
        moment=loads[:, 8:11],
        sides=sides,
    )


def numbered(parts: FloatArray, number: NDArray[np.int64]) -> FloatArray:
    """Add up the chunks of the reactions and bring them from places to numbers of elements."""
    out = np.empty(parts.shape[1:])
    out[:, number] = parts.sum(axis=0)
    return out
