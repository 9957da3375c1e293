# SPDX-License-Identifier: Apache-2.0
"""Flow in a square vessel whose lid runs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cwmav_sim.solver import Solver
from cwmav_sim.verification.flows import OUTSIDE, HeldVolume, History, at_places, plane_flow
from cwmav_sim.verification.outlines import Chain, line, outlines
from cwmav_sim.verification.protocol import Check
from cwmav_sim.wing.sheet import FloatArray

_SOURCE = "U. Ghia, K. N. Ghia, C. T. Shin, J. Comput. Phys. 48 (1982) 387, tables I and II"

# Height and horizontal velocity on the upright centre line for Re 100, 400, 1000.
_U = np.array(
    [
        (0.9766, 0.84123, 0.75837, 0.65928),
        (0.9688, 0.78871, 0.68439, 0.57492),
        (0.9609, 0.73722, 0.61756, 0.51117),
        (0.9531, 0.68717, 0.55892, 0.46604),
        (0.8516, 0.23151, 0.29093, 0.33304),
        (0.7344, 0.00332, 0.16256, 0.18719),
        (0.6172, -0.13641, 0.02135, 0.05702),
        (0.5000, -0.20581, -0.11477, -0.06080),
        (0.4531, -0.21090, -0.17119, -0.10648),
        (0.2813, -0.15662, -0.32726, -0.27805),
        (0.1719, -0.10150, -0.24299, -0.38289),
        (0.1016, -0.06434, -0.14612, -0.29730),
        (0.0703, -0.04775, -0.10338, -0.22220),
        (0.0625, -0.04192, -0.09266, -0.20196),
        (0.0547, -0.03717, -0.08186, -0.18109),
    ]
)
# Place and upward velocity on the level centre line; the printed value for Re 400 at 0.9063 is a misprint.
_V = np.array(
    [
        (0.9688, -0.05906, -0.12146, -0.21388),
        (0.9609, -0.07391, -0.15663, -0.27669),
        (0.9531, -0.08864, -0.19254, -0.33714),
        (0.9453, -0.10313, -0.22847, -0.39188),
        (0.9063, -0.16914, np.nan, -0.51550),
        (0.8594, -0.22445, -0.44993, -0.42665),
        (0.8047, -0.24533, -0.38598, -0.31966),
        (0.5000, 0.05454, 0.05186, 0.02526),
        (0.2344, 0.17527, 0.30174, 0.32235),
        (0.2266, 0.17507, 0.30203, 0.33075),
        (0.1563, 0.16077, 0.28124, 0.37095),
        (0.0938, 0.12317, 0.22965, 0.32627),
        (0.0781, 0.10890, 0.20920, 0.30353),
        (0.0703, 0.10091, 0.19713, 0.29012),
        (0.0625, 0.09233, 0.18360, 0.27485),
    ]
)
_COLUMN = {100: 1, 400: 2, 1000: 3}


@dataclass(frozen=True)
class LidDrivenCavity:
    """Side 1, speed of the lid 1; means over the last fifth of the run.

    The vessel is closed, so the volume of the air is held (``flows.HeldVolume``).

    Attributes
    ----------
    reynolds : int
        100, 400 or 1000.
    tolerance : float
        Bar [%].
    duration : float
        Time simulated, in sides over the speed of the lid.
    cells : int
        Particles along a side.
    """

    reynolds: int
    tolerance: float
    duration: float
    cells: int = 100
    slow: bool = True
    remark: str = (
        "the flow is some per cent too slow everywhere, more so the farther along its way from the lid: "
        "with 50 per side at Re 100 the speed is 2 % low close under the lid, the smallest v 5, the "
        "smallest u 7.5 and the largest v 8.6 % low. It is not unsteadiness (a finite-difference solution "
        "is within 0.3 % of steady then), nor viscosity as such (that of Re 87 would take 1.5 % off u and "
        "largest v; at Re 400 and 1000 the errors are the same 4 to 8 %). Speed of sound, time step, "
        "shifting, finer wall elements, less diffusion of density and a pressure gradient carried into the "
        "wall change nothing; h = 2 dp instead of 1.5 gives 5.5 % instead of 7.5, no keep-out distance 6.7,"
        " a background pressure of 1 or 3 rho U2 8.3 and 11.6. Where the volume of the air is not held, the"
        " mean pressure rises by 2.3 rho U2 and the smallest u is 10 % low with 50 per side, but 4.5 % with"
        " 100, where holding it gives 6.4 %: the cause is not found."
    )

    @property
    def name(self) -> str:
        """Name on the command line."""
        return f"cavity-re{self.reynolds}"

    @property
    def summary(self) -> str:
        """One line saying what is tested."""
        return f"vessel with running lid at Re {self.reynolds}, {self.cells} particles per side"

    def run(self) -> list[Check]:
        """Run the case and compare."""
        dp = 1.0 / self.cells
        side = 1.0 + 2 * OUTSIDE * dp
        flow = plane_flow(
            dp,
            side,
            side,
            upstream=0.5 * side,
            viscosity=1.0 / self.reynolds,
            sound_speed=10.0,
            set_back=0.0,
            precision="single",
        )
        a = 0.5
        walls = outlines(
            [
                Chain("floor", line((-a, -a), (a, -a))),
                Chain("left", line((-a, -a), (-a, a))),
                Chain("right", line((a, -a), (a, a))),
                Chain("lid", line((-a, a), (a, a)), surface_speed=(1.0, 0.0)),
            ],
            dp,
            lambda x: np.maximum(np.abs(x[:, 0]), np.abs(x[:, 2])) > a,
        )
        solver = Solver(flow, walls, 0.0, highest_speed=1.0)
        history = History(solver)
        column = _COLUMN[self.reynolds]
        upright = np.column_stack([np.zeros(len(_U)), _U[:, 0] - 0.5])
        level = np.column_stack([_V[:, 0] - 0.5, np.zeros(len(_V))])
        places = np.concatenate([upright, level])
        h = flow.resolution.h_over_dp * dp
        samples = []
        held = HeldVolume(solver)
        history.until(0.8 * self.duration, held)
        for t in np.linspace(0.8, 1.0, 41)[1:] * self.duration:
            history.until(float(t), held)
            samples.append(at_places(solver, places, h))
        mean = np.mean(samples, axis=0)
        u, v = mean[: len(_U), 0], mean[len(_U) :, 1]
        return [*self._profiles(u, v, column), history.balance(self.name, 1e-2)]

    def _profiles(self, u: FloatArray, v: FloatArray, column: int) -> list[Check]:
        exact_u, exact_v = _U[:, column], _V[:, column]
        known = ~np.isnan(exact_v)
        error = np.concatenate([u - exact_u, (v - exact_v)[known]])
        rms = float(np.sqrt(np.mean(error**2)))
        checks = [
            Check(
                self.name,
                "rms error of both profiles [speed of the lid]",
                rms,
                0.0,
                1.0,
                self.tolerance,
                _SOURCE,
            )
        ]
        for label, found, exact, pick in (
            ("smallest u", u, exact_u, np.argmin),
            ("largest v", v, exact_v, np.nanargmax),
            ("smallest v", v, exact_v, np.nanargmin),
        ):
            at = int(pick(exact))
            checks.append(
                Check(
                    self.name,
                    label,
                    float(found[at]),
                    float(exact[at]),
                    float(exact[at]),
                    self.tolerance,
                    _SOURCE,
                )
            )
        return checks
