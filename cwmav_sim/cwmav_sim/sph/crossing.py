# SPDX-License-Identifier: Apache-2.0
"""Safety net: no particle may pass through a wall.

After every step the side of each particle is compared with the one before. A particle that changed sides
inside the outline is put back at a tenth of a spacing on its own side and loses its speed normal to the wall
relative to it; the wall takes the opposite impulse, so momentum stays balanced, and the event is counted.
A distance that jumps by more than a quarter of a spacing within a step is no motion: near an edge or a bend
another part of the wall has become the nearest one.

Walls of particles have no such net; what passes through them is counted by the same rule.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numba as nb
import numpy as np
from numpy.typing import NDArray

from cwmav_sim.sph.state import Particles
from cwmav_sim.sph.surfaces import Sides

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BACK = 0.1  # spacings
JUMP = 0.25  # spacings


@dataclass(frozen=True)
class Crossings:
    """What crossed the walls in one step.

    Attributes
    ----------
    count : ndarray, shape (panels,)
        Particles put back, or let through by walls of particles.
    impulse : ndarray, shape (panels, 3)
        Impulse on the panels [N s].
    panel : ndarray, shape (k,)
        Panel of every event.
    x, kick : ndarray, shape (k, 3)
        Place [m] and impulse on the panel [N s] of every event.
    """

    count: IntArray
    impulse: FloatArray
    panel: IntArray
    x: FloatArray
    kick: FloatArray

    @classmethod
    def none(cls, panels: int) -> Crossings:
        """Return the record of a step in which nothing crossed."""
        empty = np.zeros((0, 3))
        return cls(np.zeros(panels, np.int64), np.zeros((panels, 3)), np.zeros(0, np.int64), empty, empty)


def put_back(particles: Particles, before: Sides, now: Sides, panels: int, dp: float, dt: float) -> Crossings:
    """Put particles that crossed a wall within the last step of ``dt`` [s] back, in place."""
    crossed = np.empty((panels, particles.count), np.bool_)
    _put_back(
        particles.x,
        particles.v,
        before.signed,
        before.inside,
        now.signed,
        now.inside,
        now.normal,
        BACK * dp,
        JUMP * dp,
        dt,
        crossed,
    )
    if not crossed.any():
        return Crossings.none(panels)
    count = crossed.sum(axis=1)
    panel, number = np.nonzero(crossed)
    speed = (now.signed[panel, number] - before.signed[panel, number]).astype(np.float64) / dt
    kick = particles.mass * speed[:, None] * now.normal[panel, :, number].astype(np.float64)
    impulse = np.zeros((panels, 3))
    np.add.at(impulse, panel, kick)
    return Crossings(count, impulse, panel, particles.x[number], kick)


def passed_through(before: Sides, now: Sides, panels: int, dp: float) -> Crossings:
    """Count the particles that went through a wall within a step and are left where they are."""
    count = np.zeros(panels, np.int64)
    _count_passed(before.signed, before.inside, now.signed, now.inside, JUMP * dp, count)
    return replace(Crossings.none(panels), count=count)


@nb.njit(cache=True, error_model="numpy")
def _passed(s0: float, s1: float, d0: float, d1: float, jump: float) -> bool:
    """Whether a particle with these distances before and now went through the wall inside its outline."""
    if s0 * s1 >= 0.0 or abs(s1 - s0) > jump:
        return False
    return d0 * abs(s1) + d1 * abs(s0) > 0.0


@nb.njit(cache=True, error_model="numpy")
def _count_passed(
    signed_before: NDArray,
    inside_before: NDArray,
    signed: NDArray,
    inside: NDArray,
    jump: float,
    count: IntArray,
) -> None:
    for c in range(count.shape[0]):
        for i in range(signed.shape[1]):
            if _passed(signed_before[c, i], signed[c, i], inside_before[c, i], inside[c, i], jump):
                count[c] += 1


@nb.njit(cache=True, parallel=True, error_model="numpy")
def _put_back(
    x: FloatArray,
    v: FloatArray,
    signed_before: NDArray,
    inside_before: NDArray,
    signed: NDArray,
    inside: NDArray,
    normal: NDArray,
    back: float,
    jump: float,
    dt: float,
    crossed: NDArray[np.bool_],
) -> None:
    for i in nb.prange(x.shape[0]):
        for c in range(crossed.shape[0]):
            s0, s1 = signed_before[c, i], signed[c, i]
            crossed[c, i] = _passed(s0, s1, inside_before[c, i], inside[c, i], jump)
            if not crossed[c, i]:
                continue
            side = 1.0 if s0 > 0.0 else -1.0
            for q in range(3):
                n = normal[c, q, i]
                x[i, q] += (side * back - s1) * n
                v[i, q] -= (s1 - s0) / dt * n
