# SPDX-License-Identifier: Apache-2.0
"""Film triangles alone: patch test, rigid rotation, a tight square membrane."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import Delaunay

from cwmav_sim.verification.protocol import Check
from cwmav_sim.wing.drive import StillRoot
from cwmav_sim.wing.dynamics import System
from cwmav_sim.wing.membrane import Membrane, lumped_mass, plane_stress
from cwmav_sim.wing.parts import Configuration, Inertia
from cwmav_sim.wing.rotation import exponential
from cwmav_sim.wing.sheet import FloatArray, IntArray
from cwmav_sim.wing.statics import at_rest, equilibrium, frequencies

_NO_BODIES = np.zeros((0, 3, 3))
_NONE = np.zeros(0, dtype=np.int64)
_MODULUS, _POISSON, _THICKNESS, _DENSITY = 2.0e8, 0.3, 1.0e-5, 920.0


def square(side: float, cells: int, rng: np.random.Generator) -> tuple[FloatArray, IntArray, IntArray]:
    """Triangulate a square irregularly: nodes (n, 2), triangles (m, 3) and the numbers of edge nodes."""
    line = np.linspace(0.0, side, cells + 1)
    grid = np.stack(np.meshgrid(line, line, indexing="ij"), axis=2).reshape(-1, 2)
    inner = np.all((grid > 0) & (grid < side), axis=1)
    grid[inner] += rng.uniform(-0.25, 0.25, (int(inner.sum()), 2)) * side / cells
    triangles = Delaunay(grid).simplices.astype(np.int64)
    a, b, c = (grid[triangles[:, k]] for k in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    triangles[area < 0] = triangles[area < 0][:, ::-1]
    return grid, triangles[np.abs(area) > 1e-6 * (side / cells) ** 2], np.flatnonzero(~inner)


def film(reference: FloatArray, triangles: IntArray) -> Membrane:
    """Return the default film on a mesh."""
    return Membrane(reference, triangles, thickness=_THICKNESS, law=plane_stress(_MODULUS, _POISSON))


def _system(reference: FloatArray, triangles: IntArray, x: FloatArray, held: IntArray) -> System:
    sheet = film(reference, triangles)
    mass = lumped_mass(sheet.areas, triangles, len(x), _DENSITY * _THICKNESS)
    return System(Inertia(mass, np.zeros((0, 3))), [sheet], StillRoot(x, _NO_BODIES, held, _NONE))


def _lifted(plane: FloatArray) -> FloatArray:
    return np.concatenate([plane, np.zeros((len(plane), 1))], axis=1)


@dataclass(frozen=True)
class FilmPatch:
    """A uniform stretch of an irregular patch, and a rigid rotation of it."""

    name: str = "structure-patch"
    summary: str = "patch test and rigid rotation of film triangles"
    slow: bool = False
    flexible: bool = True

    def run(self) -> list[Check]:
        """Run the case and compare."""
        rng = np.random.default_rng(1)
        plane, triangles, edge = square(0.1, 5, rng)
        gradient = np.array([[1.02, 0.015], [-0.005, 0.99]])
        x = _lifted(plane)
        x[edge, :2] = plane[edge] @ gradient.T
        system = _system(plane, triangles, x, edge)
        c = equilibrium(system, at_rest(x, _NO_BODIES), lambda c: np.zeros_like(c.x), tolerance=1e-9)
        stress = film(plane, triangles).stress(c)
        strain = 0.5 * (gradient.T @ gradient - np.eye(2))
        exact = plane_stress(_MODULUS, _POISSON) @ [strain[0, 0], strain[1, 1], 2.0 * strain[0, 1]]
        worst = float(np.max(np.abs(stress - exact)))
        source = "exact: a uniform stress is reproduced"
        label = "largest stress error over the stress [Pa]"
        scale = float(np.max(np.abs(exact)))
        return [
            Check(self.name, label, worst, 0.0, scale, 0.001, source),
            self._rotation(plane, triangles, rng),
        ]

    def _rotation(self, plane: FloatArray, triangles: IntArray, rng: np.random.Generator) -> Check:
        flat = _lifted(plane)
        turned = flat @ exponential(rng.normal(size=3)).T + rng.normal(size=3)
        energy = film(plane, triangles).energy(_resting(turned))
        scale = film(plane, triangles).energy(_resting(1.01 * flat))
        source = "exact: a rigid rotation stores nothing (scale: 1 % stretch)"
        return Check(self.name, "energy of a rigid rotation [J]", energy, 0.0, scale, 0.001, source)


def _resting(x: FloatArray) -> Configuration:
    return at_rest(x, _NO_BODIES)


@dataclass(frozen=True)
class DrumFrequencies:
    """A square film stretched by 1 % and held along its edge."""

    name: str = "structure-film-frequency"
    summary: str = "natural frequencies of a tight square film"
    slow: bool = False
    flexible: bool = True
    cells: int = 20
    side: float = 0.1

    def run(self) -> list[Check]:
        """Run the case and compare."""
        plane, triangles, edge = square(self.side, self.cells, np.random.default_rng(2))
        stretch = 1.01
        x = _lifted(stretch * plane)
        found, _ = frequencies(_system(plane, triangles, x, edge), at_rest(x, _NO_BODIES), 4)
        strain = 0.5 * (stretch**2 - 1.0)
        tension = _THICKNESS * _MODULUS / (1.0 - _POISSON) * strain  # second Piola-Kirchhoff, per length
        speed = math.sqrt(tension / (_DENSITY * _THICKNESS))  # material waves over the unstretched side
        source = "tight square membrane: f = c sqrt(i^2 + j^2)/(2 a)"
        checks = []
        for value, order in ((found[0], 2.0), (found[1], 5.0), (found[3], 8.0)):
            reference = speed * math.sqrt(order) / (2.0 * self.side)
            label = f"frequency of i^2 + j^2 = {order:g} [Hz]"
            checks.append(Check(self.name, label, float(value), reference, reference, 2.0, source))
        return checks
