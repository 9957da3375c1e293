# SPDX-License-Identifier: Apache-2.0
"""One carbon rod clamped at its end: large deflection, natural frequencies, energy of a free swing."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipj, ellipk, ellipkinc

from cwmav_sim.verification.protocol import Check
from cwmav_sim.wing.drive import StillRoot
from cwmav_sim.wing.dynamics import Load, System
from cwmav_sim.wing.integrate import Integration, Integrator
from cwmav_sim.wing.parts import Configuration, Inertia
from cwmav_sim.wing.rods import RodPath, Section, Stiffener, rod_elements, straight_rod
from cwmav_sim.wing.sheet import FloatArray
from cwmav_sim.wing.statics import at_rest, equilibrium, frequencies

_ELASTICA = "Bisshopp & Drucker 1945, Q. Appl. Math. 3, 272 (elliptic integrals)"
_EULER = "Euler-Bernoulli cantilever, cos(k) cosh(k) = -1"
_EXACT = "exact: nothing is lost without damping"


@dataclass(frozen=True)
class Rod:
    """A straight rod along x, clamped at the origin, with its unloaded shape."""

    system: System
    x: FloatArray
    turn: FloatArray
    section: Section
    length: float

    def at_rest(self) -> Configuration:
        """Return the unloaded shape."""
        return at_rest(self.x, self.turn)

    def pulled(self, force: float) -> Load:
        """Return the load of a force [N] along z at the free end."""
        load = np.zeros((self.system.rows, 3))
        load[len(self.x) - 1, 2] = force
        return lambda c: load


def cantilever(elements: int, *, length: float = 0.1, diameter: float = 1e-3) -> Rod:
    """Build a round carbon rod of ``elements`` equal elements."""
    section = Stiffener(0.0, 0.0, 1.0, 1.0, diameter=diameter).section()
    count = elements + 1
    x = np.zeros((count, 3))
    x[:, 0] = np.linspace(0.0, length, count)
    nodes = np.repeat(np.arange(count, dtype=np.int64)[:, None], 3, axis=1)
    weights = np.tile([1.0, 0.0, 0.0], (count, 1))
    path = RodPath(nodes, weights, x, straight_rod(x, np.array([0.0, 0.0, 1.0])), section)
    turn = np.tile(path.triad, (count, 1, 1))
    clamped = np.zeros(1, dtype=np.int64)
    system = System(
        Inertia(path.mass, path.rotary),
        [rod_elements([path], 0, count)],
        StillRoot(x, turn, clamped, clamped),
    )
    return Rod(system, x, turn, section, length)


def elastica(load: float) -> tuple[float, float]:
    """Return drop and shortening of an inextensible cantilever over its length, for P L^2/EI = ``load``.

    With the slope at the free end asin(2 k^2 - 1), K(k) - F(phi1, k) = sqrt(load) fixes the modulus k.
    """

    def misfit(k: float) -> float:
        return float(ellipk(k**2) - ellipkinc(_start(k), k**2)) - math.sqrt(load)

    k = float(brentq(misfit, math.sqrt(0.5) + 1e-12, 1.0 - 1e-12))
    arc = np.linspace(float(ellipkinc(_start(k), k**2)), float(ellipk(k**2)), 4001)
    sn, _, _, _ = ellipj(arc, k**2)
    slope = np.arcsin(np.clip(2.0 * (k * sn) ** 2 - 1.0, -1.0, 1.0))
    share = (arc - arc[0]) / (arc[-1] - arc[0])
    return float(np.trapezoid(np.sin(slope), share)), float(1.0 - np.trapezoid(np.cos(slope), share))


def _start(k: float) -> float:
    return math.asin(1.0 / (k * math.sqrt(2.0)))


@dataclass(frozen=True)
class LargeDeflection:
    """A cantilever bent by a dead load at its end."""

    name: str = "structure-elastica"
    summary: str = "large deflection of a clamped rod against the elastica"
    slow: bool = False
    flexible: bool = True
    elements: int = 20
    loads: tuple[float, ...] = (1.0, 2.0, 10.0)

    def run(self) -> list[Check]:
        """Run the case and compare."""
        rod = cantilever(self.elements)
        stiffness = rod.section.modulus * rod.section.bending_normal
        checks = []
        for load in self.loads:
            force = rod.pulled(load * stiffness / rod.length**2)
            c = equilibrium(rod.system, rod.at_rest(), force)
            drop = float(c.x[-1, 2]) / rod.length
            short = 1.0 - float(c.x[-1, 0]) / rod.length
            exact = elastica(load)
            for quantity, value, reference in (("drop", drop, exact[0]), ("shortening", short, exact[1])):
                label = f"{quantity} over length, P L^2/EI = {load:g}"
                checks.append(Check(self.name, label, value, reference, reference, 2.0, _ELASTICA))
        return checks


@dataclass(frozen=True)
class RodFrequencies:
    """First three bending frequencies of a clamped rod."""

    name: str = "structure-rod-frequency"
    summary: str = "natural frequencies of a clamped rod"
    slow: bool = False
    flexible: bool = True
    elements: int = 40

    def run(self) -> list[Check]:
        """Run the case and compare."""
        rod = cantilever(self.elements)
        found, shapes = frequencies(rod.system, rod.at_rest(), 9)
        sideways = np.max(np.abs(shapes[:, : len(rod.x), 1:]), axis=(1, 2))
        found = found[sideways > 1e-3 * sideways.max()]  # the rest is torsion
        section = rod.section
        unit = math.sqrt(section.modulus * section.bending_normal / (section.line_mass * rod.length**4))
        checks = []
        for mode, k in enumerate((1.8751040687, 4.6940911330, 7.8547574382)):
            reference = k**2 * unit / (2.0 * math.pi)
            label = f"bending frequency {mode + 1} [Hz]"
            value = float(found[2 * mode])  # a round rod has every bending shape twice
            checks.append(Check(self.name, label, value, reference, reference, 2.0, _EULER))
        return checks


@dataclass(frozen=True)
class RodEnergy:
    """A bent rod let go: what the undamped integrator does to its energy over three swings."""

    name: str = "structure-energy"
    summary: str = "energy of a swinging rod without damping"
    slow: bool = False
    flexible: bool = True
    elements: int = 8
    step: float = 4e-5
    duration: float = 0.024

    def run(self) -> list[Check]:
        """Run the case and compare."""
        rod = cantilever(self.elements)
        stiffness = rod.section.modulus * rod.section.bending_normal
        force = rod.pulled(0.5 * stiffness / rod.length**2)
        c = equilibrium(rod.system, rod.at_rest(), force)
        settings = Integration(spectral_radius=1.0, longest_step=self.step, tolerance=1e-8)
        integrator = Integrator(rod.system, settings, c.x, c.turn)
        stored = integrator.motion.energies.initial
        worst = 0.0
        for k in range(1, round(self.duration / self.step) + 1):
            energies = integrator.advance(k * self.step).energies
            worst = max(worst, abs(energies.kinetic + energies.elastic - stored))
        label = "largest change of energy over the stored energy"
        return [Check(self.name, label, worst / stored, 0.0, 1.0, 2.0, _EXACT)]
