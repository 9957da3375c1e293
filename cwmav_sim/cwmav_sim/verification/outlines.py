# SPDX-License-Identifier: Apache-2.0
"""Walls in the x-z plane for two-dimensional cases: moving bodies and thin plates, channels, vessels.

Every outline is a chain of points; the solver sees it as a strip of triangles along y.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cwmav_sim.wing.sheet import FloatArray, IntArray, SheetState

Inside = Callable[[FloatArray], NDArray[np.bool_]]


@dataclass(frozen=True)
class Pose:
    """Where a rigid body is and how it moves at one instant.

    Attributes
    ----------
    place, speed, acceleration : ndarray, shape (2,)
        Of the body's origin, x and z [m, m/s, m/s2].
    angle, rate, angular_acceleration : float
        Rotation from x towards z [rad, rad/s, rad/s2].
    """

    place: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    angle: float = 0.0
    rate: float = 0.0
    angular_acceleration: float = 0.0


def at_rest(_: float) -> Pose:
    """Return the pose of a body that stays at the origin."""
    return Pose(np.zeros(2), np.zeros(2), np.zeros(2))


@dataclass(frozen=True)
class Chain:
    """One panel: a chain of points in the frame of its body.

    Attributes
    ----------
    name : str
        Name of the panel.
    points : ndarray, shape (k, 2)
        x and z [m]; a closed chain repeats its first point.
    pose : callable
        Time [s] -> :class:`Pose`.
    surface_speed : ndarray, shape (2,)
        Speed of the surface itself on top of the motion of the body [m/s]: a running belt.
    """

    name: str
    points: FloatArray
    pose: Callable[[float], Pose] = at_rest
    surface_speed: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Outlines:
    """Chains as sheets; with ``inside`` they keep the air out of bodies."""

    chains: tuple[Chain, ...]
    width: float
    inside: Inside | None = None
    _first: tuple[int, ...] = field(init=False)

    def __post_init__(self) -> None:
        counts = [len(c.points) for c in self.chains]
        object.__setattr__(self, "_first", tuple(int(k) for k in np.cumsum([0, *counts])))

    @property
    def triangles(self) -> IntArray:
        """Node numbers of each triangle; points i at the near edge are nodes 2i, at the far edge 2i + 1."""
        out = []
        for chain, first in zip(self.chains, self._first, strict=False):
            closed = _closed(chain.points)
            i = np.arange(first, first + len(chain.points) - 1)
            following = i + 1
            if closed:
                following = np.where(following == first + len(chain.points) - 1, first, following)
            out.append(np.column_stack([2 * i, 2 * following, 2 * following + 1]))
            out.append(np.column_stack([2 * i, 2 * following + 1, 2 * i + 1]))
        return np.concatenate(out).astype(np.int64)

    @property
    def panel(self) -> IntArray:
        """Number of the chain of each triangle."""
        return np.concatenate(
            [np.full(2 * (len(c.points) - 1), k, dtype=np.int64) for k, c in enumerate(self.chains)]
        )

    @property
    def panel_names(self) -> tuple[str, ...]:
        """Names of the chains."""
        return tuple(c.name for c in self.chains)

    def state(self, t: float) -> SheetState:
        """Return the nodes at time ``t`` [s]."""
        parts = [_moved(chain, t) for chain in self.chains]
        x, v, a = (np.concatenate([p[k] for p in parts]) for k in range(3))
        return SheetState(*(self._strip(q, k == 0) for k, q in enumerate((x, v, a))))

    def holds(self, x: FloatArray) -> NDArray[np.bool_]:
        """Return which places lie inside the bodies at time zero."""
        if self.inside is None:
            return np.zeros(len(x), dtype=bool)
        return self.inside(x)

    def _strip(self, plane: FloatArray, places: bool) -> FloatArray:
        nodes = np.zeros((2 * len(plane), 3))
        nodes[:, 0], nodes[:, 2] = np.repeat(plane[:, 0], 2), np.repeat(plane[:, 1], 2)
        if places:
            nodes[:, 1] = np.tile([-0.5 * self.width, 0.5 * self.width], len(plane))
        return nodes


def outlines(chains: Sequence[Chain], dp: float, inside: Inside | None = None) -> Outlines:
    """Return chains as sheets for particles ``dp`` [m] apart, each link divided to a third of that."""
    refined = tuple(Chain(c.name, refine(c.points, dp / 3.0), c.pose, c.surface_speed) for c in chains)
    return Outlines(refined, dp / 3.0, inside)


def refine(points: FloatArray, spacing: float) -> FloatArray:
    """Divide the links of a chain so that none is longer than ``spacing`` [m]."""
    out = [np.asarray(points[:1], dtype=np.float64)]
    for a, b in pairwise(points):
        n = max(1, math.ceil(float(np.linalg.norm(b - a)) / spacing - 1e-9))
        out.append(a + (b - a) * (np.arange(1, n + 1) / n)[:, None])
    return np.concatenate(out)


def line(a: tuple[float, float], b: tuple[float, float]) -> FloatArray:
    """Return the two ends of a straight link, shape (2, 2)."""
    return np.array([a, b], dtype=np.float64)


def circle(radius: float, dp: float) -> FloatArray:
    """Return a closed circle around the origin with links of about ``dp``/3."""
    n = math.ceil(2.0 * math.pi * radius / (dp / 3.0))
    angle = np.append(np.arange(n), 0) * (2.0 * math.pi / n)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def half_ellipse(chord: float, thickness: float, sign: float, dp: float) -> FloatArray:
    """Return the upper (sign 1) or lower (-1) side of an ellipse along x, from its tail to its nose."""
    n = 2 * math.ceil(chord / (dp / 3.0))
    angle = np.linspace(0.0, math.pi, n + 1)
    return np.column_stack([0.5 * chord * np.cos(angle), sign * 0.5 * thickness * np.sin(angle)])


def _closed(points: FloatArray) -> bool:
    return bool(np.allclose(points[0], points[-1]))


def _moved(chain: Chain, t: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    pose = chain.pose(t)
    c, s = math.cos(pose.angle), math.sin(pose.angle)
    arm = chain.points @ np.array([[c, s], [-s, c]])
    across = np.column_stack([-arm[:, 1], arm[:, 0]])
    v = pose.speed + pose.rate * across + np.asarray(chain.surface_speed)
    a = pose.acceleration + pose.angular_acceleration * across - pose.rate**2 * arm
    return pose.place + arm, v, a
