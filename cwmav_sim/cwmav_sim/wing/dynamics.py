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
from copy import copy
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.sparse as sp

from cwmav_sim.wing.arithmetic import HOST, Arithmetic, Solvable, brought_tuple
from cwmav_sim.wing.drive import Carrier, Drive
from cwmav_sim.wing.motion_loops import (
    drag_powers,
    given_rates,
    inertia_tangent,
    inertial_forces,
    kinetic_energies,
    unbalanced,
)
from cwmav_sim.wing.parts import Configuration, Element, Inertia, Portable, Stiff
from cwmav_sim.wing.sheet import FloatArray, IntArray
from cwmav_sim.wing.sparsity import Gathering, Pattern, add_all, gathering

if TYPE_CHECKING:
    from cwmav_sim.wing.block_lu import Factors
    from cwmav_sim.wing.carried import CarriedAir

_ROUNDING = 8.0 * float(np.finfo(np.float64).eps)


class Places(NamedTuple):
    """Numbers of rows, where the loops over them run.

    Attributes
    ----------
    every : ndarray, shape (n + k,)
        All rows.
    free, held : ndarray, shape (f,) and (h,)
        Rows that move freely, and driven ones: first nodes, then bodies.
    nodes, bodies : ndarray
        Numbers of driven nodes and bodies.
    group : ndarray, shape (n + k,)
        Carrier frame of every row.
    driven : ndarray, shape (n + k,)
        One for driven rows, zero for free ones.
    """

    every: IntArray
    free: IntArray
    held: IntArray
    nodes: IntArray
    bodies: IntArray
    group: IntArray
    driven: IntArray


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
        self.arithmetic: Arithmetic = HOST
        self.inertia, self.drive, self.carried = inertia, drive, carried
        self.elements: tuple[Element, ...] = tuple(elements)
        self.mass_damping = mass_damping
        self.nodes, self.bodies = len(inertia.mass), len(inertia.rotary)
        self.rows = self.nodes + self.bodies
        self.held_rows = np.concatenate([drive.nodes, self.nodes + drive.bodies]).astype(np.int64)
        driven = np.zeros(self.rows, np.int64)
        driven[self.held_rows] = 1
        self.free_rows = np.flatnonzero(driven == 0)
        self.places = Places(
            np.arange(self.rows),
            self.free_rows,
            self.held_rows,
            drive.nodes,
            drive.bodies,
            np.asarray(drive.group),
            driven,
        )
        scalars = np.arange(3 * self.rows, dtype=np.int64).reshape(-1, 3)
        families = [element.dofs for element in self._with_tangent]
        self._forces = [gathering(e.dofs.ravel(), 3 * self.rows) for e in self.elements]
        self._pattern = Pattern([*families, scalars], self.rows, self.free_rows)
        self._tangents: list[Gathering] = self._pattern.gatherings

    @property
    def _with_tangent(self) -> tuple[Stiff, ...]:
        return self.elements if self.carried is None else (*self.elements, self.carried)

    @property
    def portable(self) -> bool:
        """Whether all elements can work with arrays in another place."""
        return all(isinstance(element, Portable) for element in self.elements)

    def brought(self, arithmetic: Arithmetic) -> System:
        """Return the same system with its arrays in the place of an arithmetic.

        Raises
        ------
        TypeError
            One of its elements knows only the host.
        """
        for element in self.elements:
            if not isinstance(element, Portable):
                raise TypeError(f"elements of type {type(element).__name__} are computed on the host only")
        other = copy(self)
        other.arithmetic = arithmetic
        other.inertia = Inertia(
            arithmetic.brought(self.inertia.mass), arithmetic.brought(self.inertia.rotary)
        )
        other.elements = tuple(e.brought(arithmetic) for e in self.elements if isinstance(e, Portable))
        other.carried = None if self.carried is None else self.carried.brought(arithmetic)
        other.places = brought_tuple(arithmetic, self.places)
        other._forces = [brought_tuple(arithmetic, g) for g in self._forces]
        other._tangents = [brought_tuple(arithmetic, g) for g in self._tangents]
        return other

    def room(self) -> Configuration:
        """Return room for a configuration."""
        empty, n, k = self.arithmetic.empty, self.nodes, self.bodies
        return Configuration(empty(n, 3), empty(n, 3), empty(k, 3, 3), empty(k, 3))

    def internal(self, c: Configuration) -> FloatArray:
        """Return the resisting forces of all elements, shape (n + k, 3)."""
        total = self.arithmetic.zeros(self.rows, 3)
        forces = [element.forces(c) for element in self.elements]
        add_all(self.arithmetic, self._forces, forces, self.arithmetic.flat(total))
        return total

    def unbalanced(
        self,
        rows: IntArray,
        c: Configuration,
        carrier: Carrier,
        inertial: FloatArray,
        internal: FloatArray,
        force: FloatArray,
    ) -> FloatArray:
        """Return inertial, internal and drag forces less external ones of some ``rows``, shape (f, 3)."""
        out = self.arithmetic.empty(len(rows), 3)
        mass, group = self.inertia.mass, self.places.group
        spin = self.arithmetic.brought(carrier.spin)
        self.arithmetic.run(
            unbalanced,
            len(rows),
            rows,
            inertial,
            internal,
            force,
            self.mass_damping,
            mass,
            c,
            spin,
            group,
            out,
        )
        return out

    def drag_power(self, c: Configuration, carrier: Carrier) -> tuple[float, float]:
        """Return the power the mass-proportional drag loses and the power it gives to the carrier [W]."""
        arithmetic, n = self.arithmetic, self.nodes
        lost, given = arithmetic.empty(n), arithmetic.empty(n)
        spin = arithmetic.brought(carrier.spin)
        arithmetic.run(
            drag_powers,
            n,
            self.mass_damping,
            self.inertia.mass,
            c,
            spin,
            self.places.group,
            lost,
            given,
        )
        return arithmetic.total(lost), arithmetic.total(given)

    def inertial(self, c: Configuration, acceleration: FloatArray) -> FloatArray:
        """Return the rate of change of momentum and angular momentum, shape (n + k, 3)."""
        return self._by_row(inertial_forces, c, acceleration)

    def solve_inertia(self, c: Configuration, force: FloatArray) -> FloatArray:
        """Return the acceleration that ``force`` gives, gyroscopic moments apart, shape (n + k, 3)."""
        return self._by_row(given_rates, c, force)

    def _by_row(self, loop: Callable[..., None], c: Configuration, field: FloatArray) -> FloatArray:
        out = self.arithmetic.empty(self.rows, 3)
        self.arithmetic.run(loop, self.rows, self.inertia.mass, self.inertia.rotary, c, field, out)
        return out

    def kinetic(self, c: Configuration) -> float:
        """Return the kinetic energy [J]."""
        out = self.arithmetic.empty(self.rows)
        self.arithmetic.run(kinetic_energies, self.rows, self.inertia.mass, self.inertia.rotary, c, out)
        return self.arithmetic.total(out)

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
        """Return the free part of ``dF/dq + rate dF/dv + mass_factor M``, on the host.

        The geometric stiffness uses the stresses of ``stressed``, by default those of ``c``. Within a
        step those of its start are much the better: a Newton iterate of a thin rod or film that bends by a
        finite angle is briefly stretched, and the huge spurious stress would spoil the next tangent (compare
        Magisano, Leonetti & Garcea, Int. J. Numer. Methods Eng. 109 (2017) 1237).
        Rows and columns follow ``free_rows``, three per row. The gyroscopic moment is left out: it is of
        higher order in the time step, and only the speed of convergence depends on this matrix.
        """
        return self._pattern.matrix(
            self.arithmetic.on_host(self._stored(c, rate, mass_factor, stressed or c))
        )

    def _stored(
        self, c: Configuration, rate: float, mass_factor: float, stressed: Configuration
    ) -> FloatArray:
        """Return the stored entries of :meth:`matrix`."""
        arithmetic = self.arithmetic
        values = [element.tangent(c, rate, stressed) for element in self._with_tangent]
        inertia = arithmetic.empty(self.rows, 3, 3)
        arithmetic.run(
            inertia_tangent,
            self.rows,
            mass_factor + rate * self.mass_damping,
            mass_factor,
            self.inertia.mass,
            self.inertia.rotary,
            c.turn,
            inertia,
        )
        stored = arithmetic.zeros(self._pattern.entries)
        add_all(arithmetic, self._tangents, [*values, inertia], stored)
        return stored

    def factors(
        self, c: Configuration, *, rate: float, mass_factor: float, stressed: Configuration
    ) -> Solvable:
        """Factorise what :meth:`matrix` returns; only the newest factors of a system are kept.

        Raises
        ------
        RuntimeError
            The matrix is singular.
        """
        return self.arithmetic.factors(self._pattern.lu, self._stored(c, rate, mass_factor, stressed))

    def factorised(self, matrix: sp.csc_matrix) -> Factors:
        """Factorise what :meth:`matrix` returns, on the host.

        Raises
        ------
        RuntimeError
            The matrix is singular.
        """
        return self._pattern.lu.factorised(matrix.data)

    def rounding(self, c: Configuration) -> float:
        """Return the unbalanced force [N] that rounding alone can leave: stiffness times coordinates."""
        stiffest = float(np.max(np.abs(self.matrix(c, rate=0.0, mass_factor=0.0).diagonal()), initial=0.0))
        return _ROUNDING * stiffest * self.arithmetic.largest(c.x)[0]
