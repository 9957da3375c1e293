# SPDX-License-Identifier: Apache-2.0
"""Equations of motion of a wing: nodes that move and turn, elements that resist, roots that are driven.

Every unknown is a spatial 3-vector: the displacement of a node, or the spin of a node or body that can turn.
Rows 0 .. n-1 of a vector field of shape (n + k, 3) belong to the positions, rows n .. n+k-1 to the turns.
The equations are

    M dv/dt + gyroscopic + f_internal(q, v) + a0 M (v - v_carrier) = f_external,

with diagonal translational mass and rotary inertia fixed in each turning body. The mass-proportional
damping acts on the motion relative to the driven root, so that it never brakes the stroke itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
import scipy.sparse as sp

from cwmav_sim.wing.block_lu import Factors
from cwmav_sim.wing.motion_loops import (
    add_forces,
    drag_forces,
    drag_powers,
    inertial_forces,
    kinetic_energy,
)
from cwmav_sim.wing.rotation import turn, turn_back
from cwmav_sim.wing.sheet import FloatArray, IntArray
from cwmav_sim.wing.sparsity import Pattern

if TYPE_CHECKING:
    from cwmav_sim.wing.carried import CarriedAir

_ROUNDING = 8.0 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True)
class Configuration:
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
        """Velocities and spins stacked, shape (n + k, 3)."""
        return np.concatenate([self.v, self.spin])


class Element(Protocol):
    """A family of like elements; ``dofs`` are scalar numbers ``3 row + axis`` of shape (m, d)."""

    @property
    def dofs(self) -> IntArray:
        """Scalar unknowns of each element."""
        ...

    def forces(self, c: Configuration) -> FloatArray:
        """Return the resisting forces and moments, elastic and viscous, shape (m, d)."""
        ...

    def tangent(self, c: Configuration, rate: float, stressed: Configuration) -> FloatArray:
        """Return d(forces)/dq + rate d(forces)/dv at ``c``, with the stresses of ``stressed``, (m, d, d)."""
        ...

    def energy(self, c: Configuration) -> float:
        """Return the stored elastic energy [J]."""
        ...

    def dissipation(self, c: Configuration) -> float:
        """Return the power lost to viscosity [W]."""
        ...


@dataclass(frozen=True)
class Driven:
    """Prescribed motion of the driven nodes and bodies at one instant."""

    x: FloatArray
    v: FloatArray
    a: FloatArray
    turn: FloatArray
    spin: FloatArray
    spin_rate: FloatArray


@dataclass(frozen=True)
class Carrier:
    """Frames that carry the wings: orientation (g, 3, 3) and angular velocity (g, 3) about the origin."""

    axes: FloatArray
    spin: FloatArray


class Drive(Protocol):
    """What holds a structure: numbers of driven nodes and bodies, the law of their motion, the carrier.

    ``group`` (n + k,) names the carrier frame that each row of the vector field travels with.
    """

    nodes: IntArray
    bodies: IntArray
    group: IntArray

    def at(self, t: float) -> Driven:
        """Return the prescribed motion at ``t`` [s]."""
        ...

    def carrier(self, t: float) -> Carrier:
        """Return the carrier frames at ``t`` [s]."""
        ...


class StillRoot:
    """A drive that holds nodes and bodies where they are."""

    def __init__(self, x: FloatArray, turn_: FloatArray, nodes: IntArray, bodies: IntArray) -> None:
        self.nodes = np.asarray(nodes, dtype=np.int64)
        self.bodies = np.asarray(bodies, dtype=np.int64)
        self.group = np.zeros(len(x) + len(turn_), dtype=np.int64)
        still = np.zeros((len(self.nodes), 3))
        steady = np.zeros((len(self.bodies), 3))
        self._driven = Driven(x[self.nodes], still, still, turn_[self.bodies], steady, steady)
        self._carrier = Carrier(np.eye(3)[None], np.zeros((1, 3)))

    def at(self, t: float) -> Driven:
        """Return the same rest at every time."""
        return self._driven

    def carrier(self, t: float) -> Carrier:
        """Return one frame at rest."""
        return self._carrier


@dataclass(frozen=True)
class Inertia:
    """Mass of each node (n,) [kg] and principal rotary inertia of each body (k, 3) [kg m2]."""

    mass: FloatArray
    rotary: FloatArray


Load = Callable[[Configuration], FloatArray]


class System:
    """Mass, elements and drive of one structure, with its assembled residual and tangent.

    Parameters
    ----------
    inertia : Inertia
        Masses and rotary inertias.
    elements : sequence of Element
        Everything that stores or loses energy.
    drive : Drive
        Driven nodes and bodies.
    mass_damping : float
        Rayleigh coefficient a0 [1/s] of the damping proportional to mass.
    carried : CarriedAir, optional
        Air that moves with the structure, for coupled motion.
    """

    def __init__(
        self,
        inertia: Inertia,
        elements: Sequence[Element],
        drive: Drive,
        *,
        mass_damping: float = 0.0,
        carried: CarriedAir | None = None,
    ) -> None:
        self.inertia, self.drive, self.carried = inertia, drive, carried
        self.elements = (*elements, carried) if carried is not None else tuple(elements)
        self.mass_damping = mass_damping
        self.nodes, self.bodies = len(inertia.mass), len(inertia.rotary)
        self.rows = self.nodes + self.bodies
        held = np.zeros(self.rows, dtype=bool)
        held[drive.nodes] = True
        held[self.nodes + drive.bodies] = True
        self.held_rows = np.concatenate([drive.nodes, self.nodes + drive.bodies]).astype(np.int64)
        self.free_rows = np.flatnonzero(~held)
        families = [element.dofs for element in self.elements]
        scalars = np.arange(3 * self.rows, dtype=np.int64)
        families += [scalars[: 3 * self.nodes, None], scalars[3 * self.nodes :].reshape(-1, 3)]
        self._pattern = Pattern(families, self.rows, self.free_rows)

    def internal(self, c: Configuration) -> FloatArray:
        """Return the resisting forces of all elements, shape (n + k, 3)."""
        total = np.zeros(3 * self.rows)
        for element in self.elements:
            add_forces(total, element.dofs, element.forces(c))
        return total.reshape(-1, 3)

    def drag(self, c: Configuration, carrier: Carrier) -> FloatArray:
        """Return the mass-proportional damping force on the motion relative to the carrier."""
        return drag_forces(self.mass_damping, self.inertia.mass, c.x, c.v, carrier.spin, self.drive.group)

    def drag_power(self, c: Configuration, carrier: Carrier) -> tuple[float, float]:
        """Return the power the drag loses and the power it gives to the carrier [W]."""
        return drag_powers(self.mass_damping, self.inertia.mass, c.x, c.v, carrier.spin, self.drive.group)

    def inertial(self, c: Configuration, acceleration: FloatArray) -> FloatArray:
        """Return the rate of change of momentum and angular momentum, shape (n + k, 3)."""
        return inertial_forces(self.inertia.mass, self.inertia.rotary, c.turn, c.spin, acceleration)

    def solve_inertia(self, c: Configuration, force: FloatArray) -> FloatArray:
        """Return the acceleration that ``force`` gives, gyroscopic moments apart, shape (n + k, 3)."""
        out = np.empty((self.rows, 3))
        out[: self.nodes] = force[: self.nodes] / self.inertia.mass[:, None]
        if self.bodies:
            out[self.nodes :] = turn(c.turn, turn_back(c.turn, force[self.nodes :]) / self.inertia.rotary)
        return out

    def kinetic(self, c: Configuration) -> float:
        """Return the kinetic energy [J]."""
        return kinetic_energy(self.inertia.mass, self.inertia.rotary, c.v, c.turn, c.spin)

    def elastic(self, c: Configuration) -> float:
        """Return the elastic energy [J]."""
        return sum(element.energy(c) for element in self.elements)

    def viscous_power(self, c: Configuration) -> float:
        """Return the power lost inside the elements [W]."""
        return sum(element.dissipation(c) for element in self.elements)

    def matrix(
        self,
        c: Configuration,
        *,
        rate: float,
        mass_factor: float,
        stressed: Configuration | None = None,
    ) -> sp.csc_matrix:
        """Return the free part of ``dF/dq + rate dF/dv + mass_factor M``.

        The geometric stiffness uses the stresses of ``stressed``, by default those of ``c``. Within a
        step those of its start are much the better: a Newton iterate of a thin rod or film that bends by a
        finite angle is briefly stretched, and the huge spurious stress would spoil the next tangent (compare
        Magisano, Leonetti & Garcea, Int. J. Numer. Methods Eng. 109 (2017) 1237).
        Rows and columns follow ``free_rows``, three per row. The gyroscopic moment is left out: it is of
        higher order in the time step, and only the speed of convergence depends on this matrix.
        """
        values = [element.tangent(c, rate, stressed or c) for element in self.elements]
        factor = mass_factor + rate * self.mass_damping
        values.append(np.repeat(factor * self.inertia.mass, 3))
        rotary = np.einsum("kij,kj,klj->kil", c.turn, mass_factor * self.inertia.rotary, c.turn)
        values.append(rotary)
        return self._pattern.assemble(values)

    def factorised(self, matrix: sp.csc_matrix) -> Factors:
        """Factorise what :meth:`matrix` returns.

        Raises
        ------
        RuntimeError
            The matrix is singular.
        """
        return self._pattern.lu.factorised(matrix)

    def rounding(self, c: Configuration) -> float:
        """Return the unbalanced force [N] that rounding alone can leave: stiffness times coordinates."""
        stiffest = float(np.max(np.abs(self.matrix(c, rate=0.0, mass_factor=0.0).diagonal()), initial=0.0))
        return _ROUNDING * stiffest * float(np.max(np.abs(c.x)))
