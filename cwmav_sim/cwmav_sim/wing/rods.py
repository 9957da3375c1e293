# SPDX-License-Identifier: Apache-2.0
"""Carbon rods: section constants, and rods laid on a film as chains of geometrically exact elements.

A rod passes through points of the film. The position of each of its nodes is the film's own position there,
interpolated inside one triangle; its triad is an unknown of its own. So rods may cross the mesh in any
direction, share its air loads and inertia, and still bend and twist as rods.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cwmav_common.errors import InputError
from cwmav_common.settings import setting
from cwmav_sim.wing.connector import Connectors, Ends, Stiffness
from cwmav_sim.wing.sheet import FloatArray, IntArray

_SHEAR_SHARE = 0.9  # shear correction of a solid round section (Cowper, J. Appl. Mech. 33 (1966) 335)


@dataclass(frozen=True)
class Section:
    """Constants of a rod's section; axis 1 along the rod, 2 in the film's plane, 3 normal to it.

    Attributes
    ----------
    area : float
        Area [m2].
    bending_normal : float
        Second moment for deflection normal to the film, about axis 2 [m4].
    bending_plane : float
        Second moment for deflection in the plane of the film, about axis 3 [m4].
    torsion : float
        Torsion constant [m4].
    modulus, shear_modulus : float
        Young's and shear modulus [Pa].
    density : float
        Density [kg/m3].
    """

    area: float
    bending_normal: float
    bending_plane: float
    torsion: float
    modulus: float
    shear_modulus: float
    density: float

    @property
    def translation(self) -> FloatArray:
        """Axial and shear stiffness (EA, GA, GA) [N]."""
        shear = _SHEAR_SHARE * self.shear_modulus * self.area
        return np.array([self.modulus * self.area, shear, shear])

    @property
    def rotation(self) -> FloatArray:
        """Torsion and bending stiffness (GJ, EI about 2, EI about 3) [N m2]."""
        e = self.modulus
        return np.array([self.shear_modulus * self.torsion, e * self.bending_normal, e * self.bending_plane])

    @property
    def line_mass(self) -> float:
        """Mass per length [kg/m]."""
        return self.density * self.area

    @property
    def rotary(self) -> FloatArray:
        """Rotary inertia per length about the three axes [kg m]."""
        normal, plane = self.bending_normal, self.bending_plane
        return self.density * np.array([normal + plane, normal, plane])


@dataclass(frozen=True)
class Spar:
    """Leading-edge spar: half an ellipse with its flat face in the film's plane."""

    width: float = setting(1.4e-3, "width of the spar in the plane of the film", unit="m", gt=0)
    height: float = setting(0.7e-3, "height of the spar normal to the film", unit="m", gt=0)
    modulus: float = setting(1.3e11, "Young's modulus along the spar", unit="Pa", gt=0)
    shear_modulus: float = setting(5.0e9, "shear modulus of the spar", unit="Pa", gt=0)
    density: float = setting(1600.0, "density of the spar", unit="kg/m3", gt=0)

    def section(self) -> Section:
        """Return the section; torsion by Saint-Venant's A^4/(40 I_p), within 2 % for half a disc."""
        a, h = 0.5 * self.width, self.height
        area = 0.5 * math.pi * a * h
        normal = (math.pi / 8.0 - 8.0 / (9.0 * math.pi)) * a * h**3
        plane = math.pi / 8.0 * h * a**3
        torsion = area**4 / (40.0 * (normal + plane))
        return Section(area, normal, plane, torsion, self.modulus, self.shear_modulus, self.density)


@dataclass(frozen=True)
class Stiffener:
    """Round rod from one point of the panel to another, given as (r / length, chord share)."""

    from_span: float = setting(..., "start: distance from the hinge over the wing length", ge=0, le=1)
    from_chord: float = setting(..., "start: share of the local chord behind the leading edge", ge=0, le=1)
    to_span: float = setting(..., "end: distance from the hinge over the wing length", ge=0, le=1)
    to_chord: float = setting(..., "end: share of the local chord behind the leading edge", ge=0, le=1)
    diameter: float = setting(2.8e-4, "diameter of the rod", unit="m", gt=0)
    modulus: float = setting(1.3e11, "Young's modulus along the rod", unit="Pa", gt=0)
    shear_modulus: float = setting(5.0e9, "shear modulus of the rod", unit="Pa", gt=0)
    density: float = setting(1600.0, "density of the rod", unit="kg/m3", gt=0)

    def section(self) -> Section:
        """Return the round section."""
        area = 0.25 * math.pi * self.diameter**2
        second = math.pi * self.diameter**4 / 64.0
        return Section(area, second, second, 2.0 * second, self.modulus, self.shear_modulus, self.density)


@dataclass(frozen=True)
class RodPath:
    """A rod as a chain of points on the film.

    Attributes
    ----------
    nodes, weights : ndarray, shape (p, 3)
        Film nodes around each point and their shares.
    points : ndarray, shape (p, 3)
        Positions of the points in the unloaded wing [m].
    triad : ndarray, shape (3, 3)
        Reference triad, columns: along the rod, in the film's plane, normal to it.
    section : Section
        Section constants.
    """

    nodes: IntArray
    weights: FloatArray
    points: FloatArray
    triad: FloatArray
    section: Section

    @property
    def lengths(self) -> FloatArray:
        """Length of each element [m], shape (p - 1,)."""
        return np.asarray(np.linalg.norm(np.diff(self.points, axis=0), axis=1))

    @property
    def tributary(self) -> FloatArray:
        """Length of rod that belongs to each point [m], shape (p,)."""
        share = np.zeros(len(self.points))
        share[:-1] += 0.5 * self.lengths
        share[1:] += 0.5 * self.lengths
        return share

    @property
    def mass(self) -> FloatArray:
        """Mass of the rod at each point [kg], shape (p,)."""
        return np.asarray(self.section.line_mass * self.tributary)

    @property
    def rotary(self) -> FloatArray:
        """Principal rotary inertia at each point [kg m2], shape (p, 3).

        Each point carries its tributary piece as a rigid rod, m l^2/12 besides the section's own. The
        spin of a rod about itself, which no load of a film excites, gets the same, so that it is not
        orders of magnitude softer than the rest.
        """
        own = self.tributary[:, None] * self.section.rotary
        return np.asarray(own + (self.mass * self.tributary**2 / 12.0)[:, None])


def straight_rod(points: FloatArray, normal: FloatArray) -> FloatArray:
    """Return the triad of a straight rod through ``points`` on a film with this normal."""
    along = points[-1] - points[0]
    along = along / np.linalg.norm(along)
    side = np.cross(normal, along)
    side = side / np.linalg.norm(side)
    return np.stack([along, side, np.cross(along, side)], axis=1)


def rod_elements(
    paths: list[RodPath], first_body: int, nodes_total: int, *, viscosity: float = 0.0
) -> Connectors:
    """Join the points of every rod by elements; bodies are numbered rod by rod from ``first_body``.

    The material axes of each rod body are its reference triad.
    """
    starts, ends, bodies, stiff = [], [], [], []
    body = first_body
    for path in paths:
        count = len(path.points)
        if count < 2 or np.any(path.lengths <= 0):
            raise InputError(f"rod with {count} distinct points; allowed: two or more")
        starts.append((path.nodes[:-1], path.weights[:-1]))
        ends.append((path.nodes[1:], path.weights[1:]))
        bodies.append(np.arange(body, body + count - 1, dtype=np.int64))
        length = path.lengths[:, None]
        rest = np.concatenate([length, np.zeros((count - 1, 2))], axis=1)
        stiff.append((path.section.translation / length, path.section.rotation / length, rest))
        body += count
    number = np.concatenate(bodies)
    translation, rotation, rest = (np.concatenate([s[k] for s in stiff]) for k in range(3))
    first = _plain_ends(starts, number)
    second = _plain_ends(ends, number + 1)
    return Connectors(first, second, Stiffness(translation, rotation, rest), nodes_total, viscosity=viscosity)


def _plain_ends(parts: list[tuple[IntArray, FloatArray]], body: IntArray) -> Ends:
    nodes, weights = (np.concatenate([p[k] for p in parts]) for k in range(2))
    count = len(body)
    eye = np.broadcast_to(np.eye(3), (count, 3, 3)).copy()
    return Ends(nodes.astype(np.int64), weights.astype(np.float64), body, np.zeros((count, 3)), eye)
