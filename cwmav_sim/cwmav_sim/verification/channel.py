# SPDX-License-Identifier: Apache-2.0
"""Start-up of plane Couette and Poiseuille flow between two walls."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cwmav_sim.solver import Solver
from cwmav_sim.sph.settings import FlowSettings
from cwmav_sim.verification.flows import OUTSIDE, History, plane_flow
from cwmav_sim.verification.outlines import Chain, Outlines, line, outlines
from cwmav_sim.verification.protocol import Check
from cwmav_sim.wing.sheet import FloatArray

_SOURCE = "exact series, as in J. P. Morris et al., J. Comput. Phys. 136 (1997) 214"
_TERMS = 60
_LENGTH = 12  # spacings along the walls


def _couette(y: FloatArray, t: float, viscosity: float) -> FloatArray:
    """Speed over that of the moving wall at y = 1."""
    n = np.arange(1, _TERMS)[:, None]
    series = (
        2.0
        / (n * math.pi)
        * (-1.0) ** n
        * np.sin(n * math.pi * y)
        * np.exp(-viscosity * (n * math.pi) ** 2 * t)
    )
    return np.asarray(y + series.sum(axis=0))


def _poiseuille(y: FloatArray, t: float, viscosity: float) -> FloatArray:
    """Speed over its final highest value F L^2/(8 nu)."""
    n = 2 * np.arange(_TERMS)[:, None] + 1
    series = 32.0 / (n * math.pi) ** 3 * np.sin(n * math.pi * y) * np.exp(-viscosity * (n * math.pi) ** 2 * t)
    return np.asarray(4.0 * y * (1.0 - y) - series.sum(axis=0))


@dataclass(frozen=True)
class _Channel:
    name: str
    summary: str
    cells: int = 40
    reynolds: float = 1.0
    times: tuple[float, ...] = (0.02, 0.1, 0.5)  # of L^2/nu
    slow: bool = False

    def _compare(
        self,
        flow: FlowSettings,
        walls: Outlines,
        across: int,
        along: int,
        exact: Callable[[FloatArray, float], FloatArray],
    ) -> list[Check]:
        solver = Solver(flow, walls, 0.0, highest_speed=1.0)
        history = History(solver)
        checks = []
        for t in self.times:
            history.until(t * self.reynolds)
            error = solver.velocity[:, along] - exact(solver.position[:, across] + 0.5, solver.time)
            checks.append(
                Check(
                    self.name,
                    f"largest error of the profile at t = {t:g} L2/nu [highest speed]",
                    float(np.abs(error).max()),
                    0.0,
                    1.0,
                    2.0,
                    _SOURCE,
                )
            )
        return [*checks, history.balance(self.name)]


@dataclass(frozen=True)
class Couette(_Channel):
    """Gap 1, wall at z = 1/2 starts with speed 1."""

    name: str = "couette"
    summary: str = "start-up of Couette flow at Re 1"

    def run(self) -> list[Check]:
        """Run the case and compare."""
        dp, viscosity = 1.0 / self.cells, 1.0 / self.reynolds
        length = _LENGTH * dp
        flow = plane_flow(
            dp, length, 1.0 + 2 * OUTSIDE * dp, viscosity=viscosity, sound_speed=10.0, set_back=0.0
        )
        walls = outlines(
            [
                Chain("fixed", line((0.0, -0.5), (length, -0.5))),
                Chain("moving", line((0.0, 0.5), (length, 0.5)), surface_speed=(1.0, 0.0)),
            ],
            dp,
            lambda x: np.abs(x[:, 2]) > 0.5,
        )
        return self._compare(flow, walls, 2, 0, lambda y, t: _couette(y, t, viscosity))


@dataclass(frozen=True)
class Poiseuille(_Channel):
    """Gap 1 between upright walls, driven along -z by gravity; final highest speed 1."""

    name: str = "poiseuille"
    summary: str = "start-up of Poiseuille flow at Re 1"

    def run(self) -> list[Check]:
        """Run the case and compare."""
        dp, viscosity = 1.0 / self.cells, 1.0 / self.reynolds
        height = _LENGTH * dp
        flow = plane_flow(
            dp,
            1.0 + 2 * OUTSIDE * dp,
            height,
            viscosity=viscosity,
            sound_speed=10.0,
            upstream=0.5 + OUTSIDE * dp,
            gravity=8.0 * viscosity,
            set_back=0.0,
        )
        walls = outlines(
            [
                Chain("left", line((-0.5, -0.5 * height), (-0.5, 0.5 * height))),
                Chain("right", line((0.5, -0.5 * height), (0.5, 0.5 * height))),
            ],
            dp,
            lambda x: np.abs(x[:, 0]) > 0.5,
        )
        return self._compare(flow, walls, 0, 2, lambda y, t: -_poiseuille(y, t, viscosity))
