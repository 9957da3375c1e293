# SPDX-License-Identifier: Apache-2.0
"""Contact between the two wings of a pair: impulses at node-triangle contacts.

After a step, every node nearer to a triangle of the opposite wing than the contact distance, and approaching
it, receives an impulse, the triangle's corners the opposite one by their barycentric shares. Impulses obey
Newton's law of restitution and Coulomb's law of friction,

    u_n+ >= -e u_n-,   lambda_n >= 0,   |lambda_t| <= mu lambda_n,

and are found together by projected Gauss-Seidel over all contacts (Jean, CMAME 177 (1999) 235). Each wing
keeps to the side of the other on which it started, so no contact is missed by passing through. Penetration is
undone by a limited separation speed rather than by moving nodes: a rod moved by 10 um would store more energy
than a whole stroke.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from cwmav_common.settings import setting
from cwmav_sim.wing.contact_loops import centres_of, gauss_seidel, least_distance, touched
from cwmav_sim.wing.dynamics import Configuration, System
from cwmav_sim.wing.motion import Motion
from cwmav_sim.wing.rotation import cross
from cwmav_sim.wing.sheet import FloatArray, IntArray
from cwmav_sim.wing.sheet_map import ImpactMap


@dataclass(frozen=True)
class ContactLaw:
    """Settings of the contact between the wings of a pair."""

    enabled: bool = setting(True, "whether the wings of a pair can touch")
    restitution: float = setting(0.001, "coefficient of restitution", ge=0, le=1)
    friction: float = setting(0.45, "Coulomb friction coefficient", ge=0, le=2)
    distance: float = setting(2.0e-4, "distance of the surfaces at which they touch", unit="m", gt=0)
    separation: float = setting(0.2, "share of a penetration undone per step", ge=0, le=1)
    separation_speed: float = setting(0.2, "highest speed of undoing a penetration", unit="m/s", ge=0)
    sweeps: int = setting(100, "sweeps of the impulse solver at most", ge=1, le=10000)


@dataclass(frozen=True)
class Contacts:
    """Contacts found at one instant.

    Attributes
    ----------
    node : ndarray, shape (m,)
        Touching nodes.
    corners, shares : ndarray, shape (m, 3)
        Corners of the touched triangles and barycentric shares of the touched points.
    normal : ndarray, shape (m, 3)
        Unit normals towards the node's side.
    gap : ndarray, shape (m,)
        Distances from the triangles' planes, negative when passed through [m].
    """

    node: IntArray
    corners: IntArray
    shares: FloatArray
    normal: FloatArray
    gap: FloatArray

    def __len__(self) -> int:
        return len(self.node)


class Impacts:
    """Finds and resolves the contacts of wings; one instance serves one structure.

    Parameters
    ----------
    law : ContactLaw
        Settings.
    system : System
        The structure.
    sheet : ImpactMap
        Its sheet.
    triangles, panel : ndarray
        Topology of the sheet.
    panel_names : tuple of str
        Names; panels ``upper_x`` and ``lower_x`` can touch each other.
    x : ndarray, shape (n, 3)
        Nodes at the start, where every wing is on its own side [m].
    """

    def __init__(
        self,
        law: ContactLaw,
        system: System,
        sheet: ImpactMap,
        triangles: IntArray,
        panel: IntArray,
        panel_names: tuple[str, ...],
        x: FloatArray,
    ) -> None:
        self.law, self.count, self.largest = law, 0, 0
        self._system, self._sheet = system, sheet
        self._sides = _sides(triangles, panel, panel_names, x)
        edges = x[triangles] - np.roll(x[triangles], 1, axis=1)
        self._edge = float(np.max(np.linalg.norm(edges, axis=2)))
        self._distant_until, self._previous = -np.inf, -np.inf

    def forget(self) -> None:
        """Forget when wings can touch next, as is needed after going back in time."""
        self._distant_until, self._previous = -np.inf, -np.inf

    def find(self, x: FloatArray) -> Contacts:
        """Return all contacts of the nodes at ``x`` (n, 3) [m]."""
        found = [_against(side, x, self.law.distance, self._edge) for side in self._sides]
        return Contacts(
            *(np.concatenate([getattr(f, key) for f in found]) for key in Contacts.__dataclass_fields__)
        )

    def resolve(self, motion: Motion) -> Motion:
        """Apply the impulses of all contacts to a motion just reached."""
        c = motion.configuration
        step, self._previous = motion.time - self._previous, motion.time
        if not self._sides or motion.time < self._distant_until:
            return motion
        state = self._sheet.state(c, motion.acceleration)
        contacts = self.find(state.x)
        if not len(contacts):
            self._distant_until = motion.time + self._free_time(state.x, state.v)
            return motion
        self.count += 1
        self.largest = max(self.largest, len(contacts))
        impulses = self._impulses(c, state.v, contacts, step)
        change = self._sheet.kick(c, impulses)
        after = replace(c, v=c.v + change[: self._system.nodes], spin=c.spin + change[self._system.nodes :])
        kinetic = self._system.kinetic(after)
        lost = self._system.kinetic(c) - kinetic
        energies = replace(motion.energies, kinetic=kinetic, contact=motion.energies.contact + lost)
        return replace(motion, configuration=after, energies=energies)

    def _impulses(self, c: Configuration, v: FloatArray, contacts: Contacts, step: float) -> FloatArray:
        """Nodal impulses of all contacts [N s], shape (n, 3)."""
        block = _relative(contacts, _frames(contacts.normal), len(v))
        speed = (block @ v.ravel()).reshape(-1, 3)
        compliance = (block @ self._sheet.compliance(c) @ block.T).toarray()
        depth = np.maximum(self.law.distance - contacts.gap, 0.0)
        push = np.minimum(self.law.separation * depth / max(step, 1e-9), self.law.separation_speed)
        push = np.where(contacts.gap < 0.5 * self.law.distance, push, 0.0)
        target = np.maximum(-self.law.restitution * np.minimum(speed[:, 0], 0.0), push)
        impulse = gauss_seidel(compliance, speed, target, self.law.friction, self.law.sweeps)
        return np.asarray(block.T @ impulse.ravel()).reshape(-1, 3)

    def _free_time(self, x: FloatArray, v: FloatArray) -> float:
        """Time before the wings can touch, at twice the present speeds."""
        nearest = np.inf
        for side in self._sides:
            nearest = min(nearest, least_distance(x, side.nodes, centres_of(x, side.triangles)))
        room = nearest - self._edge - self.law.distance
        fastest = float(np.sqrt(np.max(np.sum(v**2, axis=1))))
        return max(room, 0.0) / (4.0 * fastest + 1e-12)


@dataclass(frozen=True)
class _Side:
    """Nodes of one wing against the triangles of the other; ``sign`` turns normals towards the nodes."""

    nodes: IntArray
    triangles: IntArray
    sign: float


def _sides(triangles: IntArray, panel: IntArray, names: tuple[str, ...], x: FloatArray) -> tuple[_Side, ...]:
    sides = []
    for upper, name in enumerate(names):
        partner = name.replace("upper", "lower")
        if name.startswith("upper") and partner in names:
            lower = names.index(partner)
            for one, other in ((upper, lower), (lower, upper)):
                nodes = np.unique(triangles[panel == one])
                opposite = triangles[panel == other]
                normal = np.sum(_normals(x, opposite), axis=0)
                offset = x[nodes].mean(axis=0) - x[np.unique(opposite)].mean(axis=0)
                sides.append(_Side(nodes, opposite, float(np.sign(normal @ offset))))
    return tuple(sides)


def _normals(x: FloatArray, triangles: IntArray) -> FloatArray:
    a, b, c = (x[triangles[:, k]] for k in range(3))
    normal = cross(b - a, c - a)
    return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))


def _against(side: _Side, x: FloatArray, distance: float, edge: float) -> Contacts:
    """Contacts of one side."""
    triangle, shares, normal, gap = touched(x, side.nodes, side.triangles, side.sign, distance, edge)
    hit = triangle >= 0
    return Contacts(side.nodes[hit], side.triangles[triangle[hit]], shares[hit], normal[hit], gap[hit])


def _relative(contacts: Contacts, axes: FloatArray, count: int) -> sp.csr_matrix:
    """Matrix (3 m, 3 n) that gives each node's velocity relative to its triangle, in axes (m, 3, 3)."""
    nodes = np.column_stack([contacts.node, contacts.corners])
    weights = np.column_stack([np.ones(len(contacts)), -contacts.shares])
    values = axes[:, :, None, :] * weights[:, None, :, None]
    columns = np.broadcast_to(3 * nodes[:, None, :, None] + np.arange(3), values.shape)
    starts = np.arange(3 * len(contacts) + 1) * (values.size // (3 * len(contacts)))
    return sp.csr_matrix((values.ravel(), columns.ravel(), starts), shape=(3 * len(contacts), 3 * count))


def _frames(normal: FloatArray) -> FloatArray:
    """Return orthonormal axes (m, 3, 3) whose first row is the normal."""
    helper = np.eye(3)[np.argmin(np.abs(normal), axis=1)]
    first = cross(normal, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([normal, first, cross(normal, first)], axis=1)
