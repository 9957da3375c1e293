# SPDX-License-Identifier: Apache-2.0
"""The particles: positions, velocities and densities in double precision."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cwmav_sim.sph.settings import Box, Resolution

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass
class Particles:
    """State of n particles of equal mass.

    Attributes
    ----------
    x, v : ndarray, shape (n, 3)
        Position [m] and velocity [m/s].
    rho : ndarray, shape (n,)
        Density [kg/m3].
    mass : float
        Mass of a particle [kg], per metre in two dimensions.
    identity : ndarray, shape (n,)
        Number of each particle; storage order changes in the course of a run.
    """

    x: FloatArray
    v: FloatArray
    rho: FloatArray
    mass: float
    identity: IntArray

    @property
    def count(self) -> int:
        """Number of particles."""
        return len(self.rho)

    def momentum(self) -> FloatArray:
        """Total momentum [kg m/s], shape (3,)."""
        return np.asarray(self.mass * self.v.sum(axis=0))

    def without(self, removed: NDArray[np.bool_]) -> Particles:
        """Return the particles that are not ``removed``, shape (n,), numbered anew."""
        kept = ~removed
        return Particles(
            self.x[kept], self.v[kept], self.rho[kept], self.mass, np.arange(np.count_nonzero(kept))
        )

    def reorder(self, order: IntArray) -> None:
        """Store the particles in the given order."""
        self.x, self.v, self.rho = self.x[order], self.v[order], self.rho[order]
        self.identity = self.identity[order]


def lattice(
    box: Box, resolution: Resolution, rho0: float, stream: FloatArray
) -> tuple[Particles, FloatArray, FloatArray]:
    """Fill the box with a cubic lattice at rest in the stream; return it with box corner and size.

    The extents of the box are rounded to whole numbers of spacings. In the symmetric half model y begins at
    the mirror.
    """
    dp = resolution.dp
    width = 0.5 * box.width if box.symmetric else box.width
    counts = np.maximum(np.rint(np.array([box.length, width, box.height]) / dp).astype(int), 1)
    low_y = 0.0 if box.symmetric else -0.5 * counts[1] * dp
    if box.dimensions == 2:
        counts[1], low_y = 1, -0.5 * dp
    low = np.array([-box.upstream, low_y, -0.5 * counts[2] * dp])
    axes = [low[k] + (np.arange(counts[k]) + 0.5) * dp for k in range(3)]
    if box.dimensions == 2:
        axes[1] = np.zeros(1)
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    if resolution.jitter > 0.0:
        offset = np.random.default_rng(resolution.seed).uniform(-1.0, 1.0, x.shape) * resolution.jitter * dp
        if box.dimensions == 2:
            offset[:, 1] = 0.0
        x += offset
    n = len(x)
    v = np.tile(np.asarray(stream, dtype=np.float64), (n, 1))
    particles = Particles(x, v, np.full(n, rho0), rho0 * dp**box.dimensions, np.arange(n))
    return particles, low, counts * dp
