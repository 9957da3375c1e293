# SPDX-License-Identifier: Apache-2.0
"""Flat plates in motion, behind the same protocol as wings."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cwmav_sim.wing.sheet import FloatArray, IntArray, SheetState


@dataclass(frozen=True)
class OscillatingPlate:
    """A flat rectangular plate normal to z, moving along z as A (1 - cos w t).

    Attributes
    ----------
    chord, span : float
        Extents along x and y [m]; the plate is centred on the origin.
    spacing : float
        Distance between mesh nodes [m].
    amplitude : float
        A [m].
    frequency : float
        w / 2 pi [Hz].
    half : bool
        Only the part y > 0.
    """

    chord: float
    span: float
    spacing: float
    amplitude: float
    frequency: float
    half: bool = False

    @property
    def triangles(self) -> IntArray:
        """Node numbers of each triangle."""
        rows, columns = self._shape()
        first = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
        lower = np.column_stack([first, first + columns + 1, first + columns + 2])
        upper = np.column_stack([first, first + columns + 2, first + 1])
        return np.concatenate([lower, upper]).astype(np.int64)

    @property
    def panel(self) -> IntArray:
        """All triangles belong to one panel."""
        return np.zeros(len(self.triangles), dtype=np.int64)

    @property
    def panel_names(self) -> tuple[str, ...]:
        """Name of the one panel."""
        return ("plate",)

    def state(self, t: float) -> SheetState:
        """Return the nodes at time ``t`` [s]."""
        rows, columns = self._shape()
        x = np.linspace(-0.5 * self.chord, 0.5 * self.chord, rows + 1)
        y = np.linspace(0.0 if self.half else -0.5 * self.span, 0.5 * self.span, columns + 1)
        nodes = np.stack(np.meshgrid(x, y, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
        up = np.zeros_like(nodes)
        up[:, 2] = 1.0
        omega = 2.0 * math.pi * self.frequency
        place = self.amplitude * (1.0 - math.cos(omega * t))
        speed = self.amplitude * omega * math.sin(omega * t)
        return SheetState(nodes + place * up, speed * up, self.acceleration(t) * up)

    def acceleration(self, t: float) -> float:
        """Return the acceleration along z [m/s2]."""
        omega = 2.0 * math.pi * self.frequency
        return self.amplitude * omega**2 * math.cos(omega * t)

    def speed(self, t: float) -> float:
        """Return the velocity along z [m/s]."""
        omega = 2.0 * math.pi * self.frequency
        return self.amplitude * omega * math.sin(omega * t)

    def _shape(self) -> tuple[int, int]:
        span = 0.5 * self.span if self.half else self.span
        return max(1, round(self.chord / self.spacing)), max(1, round(span / self.spacing))


@dataclass(frozen=True)
class FixedPlate:
    """A flat rectangular plate at rest, its nose up against a stream along x.

    Attributes
    ----------
    chord, span : float
        Extents [m]; the plate is centred on the origin, its span along y.
    spacing : float
        Distance between mesh nodes [m].
    incidence : float
        Angle of the chord with the stream [rad].
    half : bool
        Only the part y > 0.
    """

    chord: float
    span: float
    spacing: float
    incidence: float
    half: bool = False

    @property
    def _flat(self) -> OscillatingPlate:
        return OscillatingPlate(self.chord, self.span, self.spacing, 0.0, 1.0, self.half)

    @property
    def triangles(self) -> IntArray:
        """Node numbers of each triangle."""
        return self._flat.triangles

    @property
    def panel(self) -> IntArray:
        """All triangles belong to one panel."""
        return self._flat.panel

    @property
    def panel_names(self) -> tuple[str, ...]:
        """Name of the one panel."""
        return ("plate",)

    def state(self, t: float) -> SheetState:
        """Return the nodes at time ``t`` [s]."""
        flat = self._flat.state(t)
        c, s = math.cos(self.incidence), math.sin(self.incidence)
        turn = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
        return SheetState(flat.x @ turn, 0.0 * flat.v, 0.0 * flat.a)


def added_mass_from(force: FloatArray, acceleration: FloatArray, speed: FloatArray) -> float:
    """Fit force = -m a - d v by least squares and return m [kg].

    Parameters
    ----------
    force, acceleration, speed : ndarray, shape (n,)
        Force of the air on the plate [N] and its motion.
    """
    system = -np.column_stack([acceleration, speed])
    return float(np.linalg.lstsq(system, force, rcond=None)[0][0])
