# SPDX-License-Identifier: Apache-2.0
"""Bringing wall elements to a state of the nodes: one loop over triangles, one over elements.

Written out because a step places some thousand elements twice, where thirty array operations take five times
as long as the arithmetic. Sums are taken in the order that NumPy takes on x86-64, so nothing is fused.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

_LEAST = 1e-30  # length below which an inward direction is left as it is


@nb.njit(cache=True, error_model="numpy")
def triangle_areas(x, triangles):
    """Return area vectors of triangles and their sums around the nodes.

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Positions of the nodes [m].
    triangles : ndarray, shape (t, 3), int64
        Corners.

    Returns
    -------
    area : ndarray, shape (t,)
        Areas [m2].
    around : ndarray, shape (n, 3)
        Sum of the area vectors of the triangles around every node [m2].
    """
    count = triangles.shape[0]
    vector, area = np.empty((count, 3)), np.empty(count)
    for t in range(count):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ax, ay, az = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
        bx, by, bz = x[c, 0] - x[a, 0], x[c, 1] - x[a, 1], x[c, 2] - x[a, 2]
        nx, ny, nz = 0.5 * (ay * bz - az * by), 0.5 * (az * bx - ax * bz), 0.5 * (ax * by - ay * bx)
        vector[t, 0], vector[t, 1], vector[t, 2] = nx, ny, nz
        area[t] = math.sqrt(nx * nx + ny * ny + nz * nz)
    around = np.zeros((x.shape[0], 3))
    for corner in range(3):
        for t in range(count):
            for q in range(3):
                around[triangles[t, corner], q] += vector[t, q]
    return area, around


@nb.njit(cache=True, error_model="numpy")
def place_elements(x, v, a, around, area, triangles, of, barycentric, inward_in, share, flat):
    """Bring all elements to a state of the nodes.

    Parameters
    ----------
    x, v, a : ndarray, shape (n, 3)
        Nodes: position [m], velocity [m/s] and acceleration [m/s2].
    around, area : ndarray, shape (n, 3) and (t,)
        From :func:`triangle_areas`.
    triangles : ndarray, shape (t, 3), int64
        Corners of the triangles.
    of : ndarray, shape (m,), int64
        Triangle of every element.
    barycentric : ndarray, shape (m, 3)
        Shares of its corners.
    inward_in : ndarray, shape (m, 2)
        Inward direction along the first two edges of the triangle.
    share : ndarray, shape (m,)
        Share of the area of the triangle.
    flat : bool
        Whether everything lies in the plane y = 0.

    Returns
    -------
    position, velocity, normal, inward : ndarray, shape (m, 3)
        Position [m], velocity [m/s], unit normal, in-plane unit vector away from the nearest edge.
    along, area : ndarray, shape (m,)
        Acceleration along the normal [m/s2] and area [m2].
    """
    count = of.shape[0]
    position, velocity = np.empty((count, 3)), np.empty((count, 3))
    normal, inward = np.empty((count, 3)), np.empty((count, 3))
    acceleration = np.empty(3)
    along, element_area = np.empty(count), np.empty(count)
    for e in range(count):
        t = of[e]
        i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        wi, wj, wk = barycentric[e, 0], barycentric[e, 1], barycentric[e, 2]
        for q in range(3):
            position[e, q] = wi * x[i, q] + wj * x[j, q] + wk * x[k, q]
            velocity[e, q] = wi * v[i, q] + wj * v[j, q] + wk * v[k, q]
            acceleration[q] = wi * a[i, q] + wj * a[j, q] + wk * a[k, q]
            normal[e, q] = wi * around[i, q] + wj * around[j, q] + wk * around[k, q]
            inward[e, q] = inward_in[e, 0] * (x[j, q] - x[i, q]) + inward_in[e, 1] * (x[k, q] - x[i, q])
        if flat:
            position[e, 1] = velocity[e, 1] = acceleration[1] = normal[e, 1] = inward[e, 1] = 0.0
        length = _length(normal[e])
        least = max(_length(inward[e]), _LEAST)
        for q in range(3):
            normal[e, q] /= length
            inward[e, q] /= least
        # First and last together: the order of a vector of two and what is left over.
        along[e] = (
            acceleration[0] * normal[e, 0] + acceleration[2] * normal[e, 2] + acceleration[1] * normal[e, 1]
        )
        element_area[e] = area[t] * share[e]
    return position, velocity, normal, inward, along, element_area


@nb.njit(cache=True, error_model="numpy")
def _length(vector):
    return math.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])
