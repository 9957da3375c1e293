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
from cwmav_sim.wing.arithmetic import HOST, Arithmetic
from cwmav_sim.wing.contact_loops import (
    FOUND,
    GAP,
    NORMAL,
    SHARES,
    TRIANGLE,
    centres_of,
    gauss_seidel,
    nearest_squares,
    touched,
)
from cwmav_sim.wing.dynamics import System
from cwmav_sim.wing.motion import Motion
from cwmav_sim.wing.parts import Configuration
from cwmav_sim.wing.rotation import cross
from cwmav_sim.wing.sheet import FloatArray, IntArray
from cwmav_sim.wing.sheet_map import ImpactMap, SheetMap


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
        self._system, self._sheet = system, sheet  # on the host
        self._there: SheetMap = sheet
        self._arithmetic: Arithmetic = HOST
        self._sides = _sides(triangles, panel, panel_names, x)
        edges = x[triangles] - np.roll(x[triangles], 1, axis=1)
        self._edge = float(np.max(np.linalg.norm(edges, axis=2)))
        self._distant_until, self._previous = -np.inf, -np.inf

    def bring(self, arithmetic: Arithmetic, sheet: SheetMap) -> None:
        """Look for contacts where the arrays of the structure are; impulses are found on the host."""
        self._arithmetic, self._there = arithmetic, sheet
        self._sides = tuple(side.brought(arithmetic) for side in self._sides)

    def forget(self) -> None:
        """Forget when wings can touch next, as is needed after going back in time."""
        self._distant_until, self._previous = -np.inf, -np.inf

    def find(self, x: FloatArray) -> Contacts:
        """Return all contacts of the nodes at ``x`` (n, 3) [m]."""
        found = [self._against(side, x) for side in self._sides]
        return Contacts(
            *(np.concatenate([getattr(f, key) for f in found]) for key in Contacts.__dataclass_fields__)
        )

    def resolve(self, motion: Motion) -> Motion:
        """Apply the impulses of all contacts to a motion just reached."""
        step, self._previous = motion.time - self._previous, motion.time
        if not self._sides or motion.time < self._distant_until:
            return motion
        state = self._there.state(motion.configuration, motion.acceleration)
        contacts = self.find(state.x)
        if not len(contacts):
            self._distant_until = motion.time + self._free_time(state.x, state.v)
            return motion
        self.count += 1
        self.largest = max(self.largest, len(contacts))
        return self._struck(motion.moved(self._arithmetic.on_host), contacts, step).moved(
            self._arithmetic.brought
        )

    def _struck(self, motion: Motion, contacts: Contacts, step: float) -> Motion:
        """Apply the impulses of contacts to a motion on the host."""
        c, nodes = motion.configuration, self._system.nodes
        speeds = self._sheet.state(c, motion.acceleration).v
        change = self._sheet.kick(c, self._impulses(c, speeds, contacts, step))
        after = c._replace(v=c.v + change[:nodes], spin=c.spin + change[nodes:])
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
        nearest = min(self._least_distance(side, x) for side in self._sides)
        room = nearest - self._edge - self.law.distance
        fastest = float(np.sqrt(np.max(np.sum(self._arithmetic.on_host(v) ** 2, axis=1))))
        return max(room, 0.0) / (4.0 * fastest + 1e-12)

    def _against(self, side: _Side, x: FloatArray) -> Contacts:
        """Contacts of one side."""
        arithmetic, count = self._arithmetic, len(side.nodes)
        found = arithmetic.empty(count, FOUND)
        arithmetic.run(
            touched,
            count,
            x,
            side.nodes_there,
            side.triangles_there,
            self._centres(side, x),
            side.sign,
            self.law.distance,
            self._edge,
            found,
        )
        rows = arithmetic.on_host(found)
        hit = rows[:, TRIANGLE] >= 0.0
        rows = rows[hit]
        corners = side.triangles[rows[:, TRIANGLE].astype(np.int64)]
        return Contacts(side.nodes[hit], corners, rows[:, SHARES], rows[:, NORMAL], rows[:, GAP])

    def _least_distance(self, side: _Side, x: FloatArray) -> float:
        """Least distance of the nodes of one side from the centres of the triangles [m]."""
        squares = self._arithmetic.empty(len(side.nodes))
        self._arithmetic.run(
            nearest_squares, len(side.nodes), x, side.nodes_there, self._centres(side, x), squares
        )
        return float(np.sqrt(self._arithmetic.on_host(squares).min()))

    def _centres(self, side: _Side, x: FloatArray) -> FloatArray:
        out = self._arithmetic.empty(len(side.triangles), 3)
        self._arithmetic.run(centres_of, len(side.triangles), x, side.triangles_there, out)
        return out


@dataclass(frozen=True)
class _Side:
    """Nodes of one wing against the triangles of the other; ``sign`` turns normals towards the nodes.

    ``nodes_there`` and ``triangles_there`` are the same numbers where the loops run.
    """

    nodes: IntArray
    triangles: IntArray
    sign: float
    nodes_there: IntArray
    triangles_there: IntArray

    def brought(self, arithmetic: Arithmetic) -> _Side:
        """Return the same side with its numbers in the place of an arithmetic."""
        nodes, triangles = (arithmetic.brought(v) for v in (self.nodes, self.triangles))
        return replace(self, nodes_there=nodes, triangles_there=triangles)


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
                sign = float(np.sign(normal @ offset))
                sides.append(_Side(nodes, opposite, sign, nodes, opposite))
    return tuple(sides)


def _normals(x: FloatArray, triangles: IntArray) -> FloatArray:
    a, b, c = (x[triangles[:, k]] for k in range(3))
    normal = cross(b - a, c - a)
    return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))


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
