# SPDX-License-Identifier: Apache-2.0
"""What a structure is made of: where everything is, masses, and elements that resist."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from cwmav_sim.wing.arithmetic import Arithmetic
from cwmav_sim.wing.sheet import FloatArray, IntArray


class Configuration(NamedTuple):
    """Where everything is and how fast it moves.

    Attributes
    ----------
    x, v : ndarray, shape (n, 3)
        Positions [m] and velocities [m/s].
    turn, spin : ndarray, shapes (k, 3, 3) and (k, 3)
        Rotation from each body's material axes to space, and angular velocity in space [rad/s].
    """

    x: FloatArray
    v: FloatArray
    turn: FloatArray
    spin: FloatArray

    @property
    def rates(self) -> FloatArray:
        """Velocities and spins stacked, shape (n + k, 3); on the host only."""
        return np.concatenate([self.v, self.spin])


class Stiff(Protocol):
    """A family of like things with a tangent.

    ``dofs`` are numbers ``3 row + axis`` of scalar unknowns, shape (m, d).
    """

    @property
    def dofs(self) -> IntArray:
        """Scalar unknowns of each, on the host."""
        ...

    def tangent(self, c: Configuration, rate: float, stressed: Configuration) -> FloatArray:
        """Return d(forces)/dq + rate d(forces)/dv at ``c`` with the stresses of ``stressed``: m (d, d)."""
        ...


class Element(Stiff, Protocol):
    """A family of like elements."""

    def forces(self, c: Configuration) -> FloatArray:
        """Return the resisting forces and moments, elastic and viscous: m times d numbers."""
        ...

    def energy(self, c: Configuration) -> float:
        """Return the stored elastic energy [J]."""
        ...

    def dissipation(self, c: Configuration) -> float:
        """Return the power lost to viscosity [W]."""
        ...


@runtime_checkable
class Portable(Element, Protocol):
    """Elements that can work with arrays in another place."""

    def brought(self, arithmetic: Arithmetic) -> Portable:
        """Return the same elements there."""
        ...


@dataclass(frozen=True)
class Inertia:
    """Mass of each node (n,) [kg] and principal rotary inertia of each body (k, 3) [kg m2]."""

    mass: FloatArray
    rotary: FloatArray
