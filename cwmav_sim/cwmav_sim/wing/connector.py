# SPDX-License-Identifier: Apache-2.0
"""Elastic connection of two turning bodies: one element of a carbon rod, or one joint of the lattice.

Two triads R1, R2 sit at attachment points that hang on arms from the bodies. With the rotation vector psi of
R1'R2 and the triad Rm = R1 exp(psi/2) half way between them, the element strains are

    e = Rm'(x2 - x1) - d0,     psi,       energy = sum(k_t e^2)/2 + sum(k_r psi^2)/2.

Both are unchanged by rigid motions. With k_t = (EA, GA, GA)/L and k_r = (GJ, EI2, EI3)/L this is the
geometrically exact (Simo-Reissner) rod with one-point quadrature, free of shear locking; with arms and other
constants it is a ball joint with linear springs. Forces are the exact gradient of the energy:

    n = Rm k_t e,  h = n x d,  p = Rm psi,  d(wm) = (dw1 + dw2)/2 - tau p x (dw2 - dw1)/2,
    tau = tan(psi/4)/psi,      d(psi) = S Rm'(dw2 - dw1),   S = a I + (1 - a) nn',  a = (psi/2)/sin(psi/2).

Sources: Simo & Vu-Quoc, CMAME 58 (1986) 79; Crisfield & Jelenic, Proc. R. Soc. A 455 (1999) 1125, on
objectivity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cwmav_sim.wing.dynamics import Configuration
from cwmav_sim.wing.kernels import connector_forces
from cwmav_sim.wing.rotation import cross, exponential, logarithm, skew, turn, turn_back
from cwmav_sim.wing.sheet import FloatArray, IntArray


@dataclass(frozen=True)
class Ends:
    """One end of every connector.

    Attributes
    ----------
    nodes, weights : ndarray, shape (m, w)
        Position rows and weights whose sum is the end's position (a body: itself with weight 1).
    body : ndarray, shape (m,)
        Body that carries the triad.
    arm : ndarray, shape (m, 3)
        Offset of the attachment point in the body's material axes [m].
    triad : ndarray, shape (m, 3, 3)
        Triad in the body's material axes.
    """

    nodes: IntArray
    weights: FloatArray
    body: IntArray
    arm: FloatArray
    triad: FloatArray

    def position(self, field: FloatArray) -> FloatArray:
        """Interpolate a field of positions or velocities at this end, shape (m, 3)."""
        return np.asarray(np.einsum("mw,mwi->mi", self.weights, field[self.nodes]))


@dataclass(frozen=True)
class Stiffness:
    """Constants of the connectors.

    Attributes
    ----------
    translation : ndarray, shape (m, 3)
        k_t [N/m] along the axes of the middle triad.
    rotation : ndarray, shape (m, 3)
        k_r [N m/rad] about them.
    rest : ndarray, shape (m, 3)
        Unstrained offset d0 of the ends in the triad [m].
    """

    translation: FloatArray
    rotation: FloatArray
    rest: FloatArray


@dataclass(frozen=True)
class _Kinematics:
    arm1: FloatArray
    arm2: FloatArray
    d: FloatArray
    middle: FloatArray
    psi: FloatArray
    tau: FloatArray  # (m, 1)
    swell: FloatArray  # the factor a of S, (m, 1)
    axis: FloatArray  # unit vector of psi (zero where psi is)


class Connectors:
    """A family of connectors; see the module for the equations.

    Parameters
    ----------
    first, second : Ends
        The two ends.
    stiffness : Stiffness
        Elastic constants.
    nodes_total : int
        Number of position rows, after which the bodies' rows follow.
    viscosity : float
        Rayleigh coefficient a1 [s].
    """

    def __init__(
        self, first: Ends, second: Ends, stiffness: Stiffness, nodes_total: int, *, viscosity: float = 0.0
    ) -> None:
        self.first, self.second, self.stiffness, self.viscosity = first, second, stiffness, viscosity
        bodies1, bodies2 = (nodes_total + end.body[:, None] for end in (first, second))
        rows = np.concatenate([first.nodes, bodies1, second.nodes, bodies2], axis=1)
        self._dofs = (3 * rows[:, :, None] + np.arange(3)).reshape(len(rows), -1)
        self._spread = _spread(first.weights, second.weights)

    @property
    def dofs(self) -> IntArray:
        """Scalar unknowns: nodes of the first end, its body, nodes of the second end, its body."""
        return self._dofs

    def forces(self, c: Configuration) -> FloatArray:
        """Return the resisting forces and moments, shape (m, d)."""
        one, two, k = self.first, self.second, self.stiffness
        forces: FloatArray = connector_forces(
            c.x,
            c.v,
            c.turn,
            c.spin,
            one.nodes,
            one.weights,
            one.body,
            one.arm,
            one.triad,
            two.nodes,
            two.weights,
            two.body,
            two.arm,
            two.triad,
            k.translation,
            k.rotation,
            k.rest,
            self.viscosity,
        )
        return forces.reshape(len(forces), -1)

    def tangent(self, c: Configuration, rate: float, stressed: Configuration) -> FloatArray:
        """Return the stiffness with its viscous part, shape (m, d, d).

        Derivatives of tau and S are left out: they are of second order in psi, below 1 % of the term they
        would correct at 0.3 rad per element, and only convergence depends on them.
        """
        k = self._kinematics(c)
        force, moment = self._resultants(stressed, self._kinematics(stressed))
        local = self._local_tangent(k, force, moment, 1.0 + self.viscosity * rate)
        count = len(local)
        half = np.einsum("mra,macjd->mrcjd", self._spread, local.reshape(count, 4, 3, 4, 3))
        full = np.einsum("mrcjd,msj->mrcsd", half, self._spread)
        size = self._dofs.shape[1]
        return np.asarray(full.reshape(count, size, size))

    def energy(self, c: Configuration) -> float:
        """Return the elastic energy [J]."""
        k = self._kinematics(c)
        stretch = turn_back(k.middle, k.d) - self.stiffness.rest
        stored = np.sum(self.stiffness.translation * stretch**2)
        return 0.5 * float(stored + np.sum(self.stiffness.rotation * k.psi**2))

    def dissipation(self, c: Configuration) -> float:
        """Return the viscous power [W]."""
        if not self.viscosity:
            return 0.0
        stretch, bend = self._strain_rates(c, self._kinematics(c))
        lost = np.sum(self.stiffness.translation * stretch**2)
        return self.viscosity * float(lost + np.sum(self.stiffness.rotation * bend**2))

    def _kinematics(self, c: Configuration) -> _Kinematics:
        turn1, turn2 = c.turn[self.first.body], c.turn[self.second.body]
        arm1, arm2 = turn(turn1, self.first.arm), turn(turn2, self.second.arm)
        d = self.second.position(c.x) + arm2 - self.first.position(c.x) - arm1
        r1, r2 = turn1 @ self.first.triad, turn2 @ self.second.triad
        psi = logarithm(np.swapaxes(r1, 1, 2) @ r2)
        angle = np.sqrt(np.einsum("mi,mi->m", psi, psi))[:, None]
        small = angle < 1e-6
        safe = np.where(small, 1.0, angle)
        tau = np.where(small, 0.25, np.tan(0.25 * safe) / safe)
        swell = np.where(small, 1.0, 0.5 * safe / np.sin(0.5 * safe))
        axis = np.where(small, 0.0, psi / safe)
        return _Kinematics(arm1, arm2, d, r1 @ exponential(0.5 * psi), psi, tau, swell, axis)

    def _resultants(self, c: Configuration, k: _Kinematics) -> tuple[FloatArray, FloatArray]:
        """Force and moment, elastic and viscous, in the middle triad."""
        stretch = turn_back(k.middle, k.d) - self.stiffness.rest
        bend = k.psi
        if self.viscosity:
            stretch_rate, bend_rate = self._strain_rates(c, k)
            stretch = stretch + self.viscosity * stretch_rate
            bend = bend + self.viscosity * bend_rate
        return self.stiffness.translation * stretch, self.stiffness.rotation * bend

    def _strain_rates(self, c: Configuration, k: _Kinematics) -> tuple[FloatArray, FloatArray]:
        spin1, spin2 = c.spin[self.first.body], c.spin[self.second.body]
        flow = self.second.position(c.v) - self.first.position(c.v)
        flow = flow + cross(spin2, k.arm2) - cross(spin1, k.arm1)
        difference = spin2 - spin1
        middle_spin = 0.5 * (spin1 + spin2) - 0.5 * k.tau * cross(turn(k.middle, k.psi), difference)
        stretch = turn_back(k.middle, flow - cross(middle_spin, k.d))
        return stretch, _swollen(k, turn_back(k.middle, difference))

    def _local_tangent(
        self, k: _Kinematics, force: FloatArray, moment: FloatArray, gain: float
    ) -> FloatArray:
        """Tangent over (x1, w1, x2, w2), shape (m, 12, 12); every operator maps those 12 to 3."""
        n, p = turn(k.middle, force), turn(k.middle, k.psi)
        h, spatial_moment = cross(n, k.d), turn(k.middle, _swollen(k, moment))
        x1, w1, x2, w2 = _selectors(len(n))
        arm1, arm2, d_matrix, n_matrix, p_matrix = (skew(a) for a in (k.arm1, k.arm2, k.d, n, p))
        half_tau = 0.5 * k.tau[:, :, None]
        delta = w2 - w1
        middle = 0.5 * (w1 + w2) - half_tau * (p_matrix @ delta)
        stretch = x2 - x1 - arm2 @ w2 + arm1 @ w1
        back = np.swapaxes(k.middle, 1, 2)
        swell = _swell_matrix(k)
        bend = k.middle @ swell @ back @ delta
        axial = k.middle * (gain * self.stiffness.translation)[:, None, :] @ back
        bending = k.middle @ swell * (gain * self.stiffness.rotation)[:, None, :] @ swell @ back
        d_n = axial @ (stretch + d_matrix @ middle) - n_matrix @ middle
        d_h = n_matrix @ stretch - d_matrix @ d_n
        d_moment = bending @ delta - skew(spatial_moment) @ middle
        d_p = bend - p_matrix @ middle
        d_twist = half_tau * (skew(h) @ d_p - p_matrix @ d_h)
        first = 0.5 * d_h + d_twist - d_moment - arm1 @ d_n - n_matrix @ arm1 @ w1
        second = 0.5 * d_h - d_twist + d_moment + arm2 @ d_n + n_matrix @ arm2 @ w2
        return np.concatenate([-d_n, first, d_n, second], axis=1)


def _swollen(k: _Kinematics, a: FloatArray) -> FloatArray:
    """S a, with the symmetric matrix S of the module's equations."""
    along = np.einsum("mi,mi->m", k.axis, a)[:, None]
    return np.asarray(k.swell * a + (1.0 - k.swell) * along * k.axis)


def _swell_matrix(k: _Kinematics) -> FloatArray:
    outer = k.axis[:, :, None] * k.axis[:, None, :]
    return np.asarray(k.swell[:, :, None] * np.eye(3) + (1.0 - k.swell)[:, :, None] * outer)


def _selectors(count: int) -> tuple[FloatArray, ...]:
    eye = np.eye(12).reshape(4, 3, 12)
    return tuple(np.broadcast_to(eye[i], (count, 3, 12)) for i in range(4))


def _spread(first: FloatArray, second: FloatArray) -> FloatArray:
    """How the four local vectors fall on the element's rows, shape (m, rows, 4)."""
    count, one, two = len(first), first.shape[1], second.shape[1]
    out = np.zeros((count, one + two + 2, 4))
    out[:, :one, 0] = first
    out[:, one, 1] = 1.0
    out[:, one + 1 : one + 1 + two, 2] = second
    out[:, -1, 3] = 1.0
    return out
