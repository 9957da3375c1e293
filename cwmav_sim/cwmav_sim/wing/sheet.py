# SPDX-License-Identifier: Apache-2.0
"""The seam between wings and air: a moving surface without thickness.

The fluid solver knows a wing only through this protocol, so a prescribed wing, a spring lattice or a
finite-element membrane can stand behind it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class SheetState:
    """Nodes of the sheets at one instant, in the wind frame.

    Attributes
    ----------
    x, v, a : ndarray, shape (n, 3), float64
        Position [m], velocity [m/s] and acceleration [m/s2] of every node.
    """

    x: FloatArray
    v: FloatArray
    a: FloatArray


@runtime_checkable
class SheetMotion(Protocol):
    """Triangulated thin surfaces whose motion is known when asked for.

    Attributes
    ----------
    triangles : ndarray, shape (m, 3), int64
        Node numbers of each triangle; the topology never changes.
    panel : ndarray, shape (m,), int64
        Number of the panel each triangle belongs to, 0 .. ``len(panel_names) - 1``.
    panel_names : tuple of str
        Names of the panels, in the order of their numbers.
    """

    @property
    def triangles(self) -> IntArray:
        """Node numbers of each triangle."""
        ...

    @property
    def panel(self) -> IntArray:
        """Panel number of each triangle."""
        ...

    @property
    def panel_names(self) -> tuple[str, ...]:
        """Names of the panels."""
        ...

    def state(self, t: float) -> SheetState:
        """Return the nodes at time ``t`` [s]; equal times give equal states."""
        ...


def triangle_areas(x: FloatArray, triangles: IntArray) -> FloatArray:
    """Return the area of every triangle.

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Node positions [m].
    triangles : ndarray, shape (m, 3)
        Node numbers.

    Returns
    -------
    ndarray, shape (m,)
        Areas [m2].
    """
    a, b, c = (x[triangles[:, k]] for k in range(3))
    areas: FloatArray = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return areas
