# SPDX-License-Identifier: Apache-2.0
"""Turek & Hron's elastic flag without fluid: deflection (CSM1) and free oscillation (CSM3) under gravity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cwmav_sim.verification.protocol import Check
from cwmav_sim.verification.structure_solid import Solid, plane_strain, solid_mass
from cwmav_sim.wing.carried import CarriedAir, node_blocks
from cwmav_sim.wing.drive import StillRoot
from cwmav_sim.wing.dynamics import System
from cwmav_sim.wing.integrate import Integration, Integrator
from cwmav_sim.wing.parts import Configuration, Inertia
from cwmav_sim.wing.sheet import FloatArray, IntArray
from cwmav_sim.wing.statics import at_rest, equilibrium

_SOURCE = "Turek & Hron 2006, Lect. Notes Comput. Sci. Eng. 53, 371"
NO_BODIES = np.zeros((0, 3, 3))
DENSITY, MODULUS, POISSON, GRAVITY = 1000.0, 1.4e6, 0.4, 2.0
CYLINDER, RADIUS, END, HEIGHT = (0.2, 0.2), 0.05, 0.6, 0.02


@dataclass(frozen=True)
class Flag:
    """The flag as a system: nodes, their grid, point A at the middle of its free end, and its weight."""

    system: System
    x: FloatArray
    number: IntArray
    tip: int
    weight: FloatArray

    def load(self, c: Configuration) -> FloatArray:
        """Return the weight of every node [N/m]."""
        return self.weight


def flag(along: int, across: int, density: float = DENSITY, modulus: float = MODULUS) -> Flag:
    """Mesh the flag with ``along`` x ``across`` nine-node cells; its root follows the cylinder."""
    rows, columns = 2 * across + 1, 2 * along + 1
    y = CYLINDER[1] + HEIGHT * (np.linspace(0.0, 1.0, rows) - 0.5)
    root = CYLINDER[0] + np.sqrt(RADIUS**2 - (y - CYLINDER[1]) ** 2)
    share = np.linspace(0.0, 1.0, columns)
    x = np.zeros((rows * columns, 3))
    x[:, 0] = (root[:, None] + share * (END - root[:, None])).ravel()
    x[:, 1] = np.repeat(y, columns)
    number = np.arange(rows * columns).reshape(rows, columns)
    cells = _cells(number, along, across)
    mass = solid_mass(x, cells, density)
    system = System(
        Inertia(mass, np.zeros((0, 3))),
        [Solid(x, cells, plane_strain(modulus, POISSON))],
        StillRoot(x, NO_BODIES, number[:, 0], np.zeros(0, dtype=np.int64)),
        carried=CarriedAir(node_blocks(len(x))),
    )
    weight = np.zeros_like(x)
    weight[:, 1] = -GRAVITY * mass
    return Flag(system, x, number, int(number[rows // 2, -1]), weight)


def _cells(number: IntArray, along: int, across: int) -> IntArray:
    cells = [
        number[2 * j : 2 * j + 3, 2 * i : 2 * i + 3].ravel() for j in range(across) for i in range(along)
    ]
    return np.array(cells, dtype=np.int64)


@dataclass(frozen=True)
class FlagAtRest:
    """CSM1: the flag hanging under its weight."""

    name: str = "structure-csm1"
    summary: str = "Turek-Hron CSM1: static deflection of an elastic flag under gravity"
    slow: bool = False
    flexible: bool = True
    along: int = 35
    across: int = 2

    def run(self) -> list[Check]:
        """Run the case and compare."""
        body = flag(self.along, self.across)
        c = equilibrium(body.system, at_rest(body.x, NO_BODIES), body.load)
        moved = 1e3 * (c.x - body.x)[body.tip]
        return [
            Check(self.name, "tip displacement x [mm]", float(moved[0]), -7.187, 7.187, 2.0, _SOURCE),
            Check(self.name, "tip displacement y [mm]", float(moved[1]), -66.10, 66.10, 2.0, _SOURCE),
        ]


@dataclass(frozen=True)
class FlagSwinging:
    """CSM3: the same flag let go from its straight shape, undamped."""

    name: str = "structure-csm3"
    summary: str = "Turek-Hron CSM3: free oscillation of an elastic flag under gravity"
    slow: bool = False
    flexible: bool = True
    along: int = 20
    across: int = 1
    step: float = 0.01
    duration: float = 3.0
    modulus: float = MODULUS

    def run(self) -> list[Check]:
        """Run the case and compare."""
        t, moved = self.history()
        mean, swing, frequency = _oscillation(t, moved[:, 1])
        mean_x, swing_x, _ = _oscillation(t, moved[:, 0])
        return [
            Check(self.name, "mean of tip y [mm]", mean, -63.607, 63.607, 2.0, _SOURCE),
            Check(self.name, "amplitude of tip y [mm]", swing, 65.160, 65.160, 2.0, _SOURCE),
            Check(self.name, "frequency of tip y [Hz]", frequency, 1.0995, 1.0995, 2.0, _SOURCE),
            Check(self.name, "mean of tip x [mm]", mean_x, -14.305, 14.305, 2.0, _SOURCE),
            Check(self.name, "amplitude of tip x [mm]", swing_x, 14.305, 14.305, 2.0, _SOURCE),
        ]

    def history(self) -> tuple[FloatArray, FloatArray]:
        """Return times (s,) [s] and tip displacements (s, 2) [mm]."""
        body = flag(self.along, self.across, modulus=self.modulus)
        settings = Integration(spectral_radius=0.95, longest_step=self.step)
        integrator = Integrator(body.system, settings, body.x, NO_BODIES, load=body.load)
        t = self.step * np.arange(1, round(self.duration / self.step) + 1, dtype=np.float64)
        moved = [integrator.advance(float(now), body.load).configuration.x[body.tip] for now in t]
        return t, np.asarray(1e3 * (np.array(moved) - body.x[body.tip])[:, :2], dtype=np.float64)


def _oscillation(t: FloatArray, y: FloatArray) -> tuple[float, float, float]:
    """Mean and amplitude from the extremes, frequency from the minima, refined by parabolas."""
    low = [_extreme(t, y, i) for i in range(1, len(y) - 1) if y[i - 1] > y[i] <= y[i + 1]]
    high = [_extreme(t, y, i) for i in range(1, len(y) - 1) if y[i - 1] < y[i] >= y[i + 1]]
    low = [e for e in low if e[1] < 0.5 * y.min()]
    bottom = float(np.mean([e[1] for e in low]))
    top = float(np.mean([e[1] for e in high if e[1] > 0.5 * y.min()]))
    frequency = (len(low) - 1) / (low[-1][0] - low[0][0])
    return 0.5 * (bottom + top), 0.5 * (top - bottom), float(frequency)


def _extreme(t: FloatArray, y: FloatArray, i: int) -> tuple[float, float]:
    before, here, after = y[i - 1], y[i], y[i + 1]
    bend = before - 2.0 * here + after
    shift = 0.5 * (before - after) / bend if bend else 0.0
    return float(t[i] + shift * (t[i + 1] - t[i])), float(here - 0.25 * (before - after) * shift)
