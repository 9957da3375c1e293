# SPDX-License-Identifier: Apache-2.0
"""Compiled forces of film and connectors: what every Newton iteration evaluates.

The same equations as in :mod:`cwmav_sim.wing.membrane` and :mod:`cwmav_sim.wing.connector`, element by
element. Energies and tangents, needed less often, stay there in array form; the tests hold both to each
other.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from cwmav_sim.wing.sheet import FloatArray, IntArray

_compiled = numba.njit(cache=True, error_model="numpy")


@_compiled
def film_forces(
    x: FloatArray,
    v: FloatArray,
    triangles: IntArray,
    gradients: FloatArray,
    volume: FloatArray,
    law: FloatArray,
    viscosity: float,
) -> FloatArray:
    """Return the nodal forces of every triangle, shape (m, 9)."""
    out = np.empty((len(triangles), 9))
    f, flow = np.empty((3, 2)), np.empty((3, 2))
    strain, stress = np.empty(3), np.empty(3)
    for m in range(len(triangles)):
        g = gradients[m]
        for i in range(3):
            for k in range(2):
                f[i, k] = 0.0
                flow[i, k] = 0.0
                for a in range(3):
                    f[i, k] += x[triangles[m, a], i] * g[a, k]
                    flow[i, k] += v[triangles[m, a], i] * g[a, k]
        strain[:] = 0.0
        for i in range(3):
            strain[0] += 0.5 * f[i, 0] * f[i, 0] + viscosity * f[i, 0] * flow[i, 0]
            strain[1] += 0.5 * f[i, 1] * f[i, 1] + viscosity * f[i, 1] * flow[i, 1]
            strain[2] += f[i, 0] * f[i, 1] + viscosity * (f[i, 0] * flow[i, 1] + f[i, 1] * flow[i, 0])
        strain[0] -= 0.5
        strain[1] -= 0.5
        for k in range(3):
            stress[k] = volume[m] * (law[k, 0] * strain[0] + law[k, 1] * strain[1] + law[k, 2] * strain[2])
        for i in range(3):
            first = f[i, 0] * stress[0] + f[i, 1] * stress[2]
            second = f[i, 0] * stress[2] + f[i, 1] * stress[1]
            for a in range(3):
                out[m, 3 * a + i] = g[a, 0] * first + g[a, 1] * second
    return out


@_compiled
def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    out = np.empty(3)
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    return out


@_compiled
def _turn(r: FloatArray, a: FloatArray) -> FloatArray:
    out = np.empty(3)
    for i in range(3):
        out[i] = r[i, 0] * a[0] + r[i, 1] * a[1] + r[i, 2] * a[2]
    return out


@_compiled
def _turn_back(r: FloatArray, a: FloatArray) -> FloatArray:
    out = np.empty(3)
    for i in range(3):
        out[i] = r[0, i] * a[0] + r[1, i] * a[1] + r[2, i] * a[2]
    return out


@_compiled
def _product(a: FloatArray, b: FloatArray) -> FloatArray:
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]
    return out


@_compiled
def _relative_vector(r1: FloatArray, r2: FloatArray) -> FloatArray:
    """Rotation vector of r1' r2."""
    q = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            q[i, j] = r1[0, i] * r2[0, j] + r1[1, i] * r2[1, j] + r1[2, i] * r2[2, j]
    out = np.empty(3)
    out[0], out[1], out[2] = q[2, 1] - q[1, 2], q[0, 2] - q[2, 0], q[1, 0] - q[0, 1]
    sine = 0.5 * math.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2)
    angle = math.atan2(sine, 0.5 * (q[0, 0] + q[1, 1] + q[2, 2] - 1.0))
    factor = 0.5 + angle**2 / 12.0 if angle < 1e-4 else 0.5 * angle / sine
    return out * factor


@_compiled
def _rotation(vector: FloatArray) -> FloatArray:
    """Rotation by a vector (Rodrigues)."""
    square = vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2
    angle = math.sqrt(square)
    if angle < 1e-4:
        first, second = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        first, second = math.sin(angle) / angle, (1.0 - math.cos(angle)) / square
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            out[i, j] = second * vector[i] * vector[j]
        out[i, i] += 1.0 - second * square
    out[0, 1] -= first * vector[2]
    out[0, 2] += first * vector[1]
    out[1, 0] += first * vector[2]
    out[1, 2] -= first * vector[0]
    out[2, 0] -= first * vector[1]
    out[2, 1] += first * vector[0]
    return out


@_compiled
def _swollen(psi: FloatArray, angle: float, a: FloatArray) -> FloatArray:
    """S a of the connector's equations."""
    if angle < 1e-6:
        return a.copy()
    swell = 0.5 * angle / math.sin(0.5 * angle)
    along = (psi[0] * a[0] + psi[1] * a[1] + psi[2] * a[2]) / angle**2
    out: FloatArray = swell * a + (1.0 - swell) * along * psi
    return out


@_compiled
def _mean(field: FloatArray, nodes: IntArray, weights: FloatArray) -> FloatArray:
    out = np.zeros(3)
    for k in range(len(nodes)):
        for i in range(3):
            out[i] += weights[k] * field[nodes[k], i]
    return out


@_compiled
def connector_forces(
    x: FloatArray,
    v: FloatArray,
    turn: FloatArray,
    spin: FloatArray,
    nodes1: IntArray,
    weights1: FloatArray,
    body1: IntArray,
    arms1: FloatArray,
    triads1: FloatArray,
    nodes2: IntArray,
    weights2: FloatArray,
    body2: IntArray,
    arms2: FloatArray,
    triads2: FloatArray,
    translation: FloatArray,
    rotation: FloatArray,
    rest: FloatArray,
    viscosity: float,
) -> FloatArray:
    """Return the forces on both ends' nodes and bodies, shape (m, w1 + 1 + w2 + 1, 3)."""
    one, two = nodes1.shape[1], nodes2.shape[1]
    out = np.empty((len(body1), one + two + 2, 3))
    for m in range(len(body1)):
        turn1, turn2 = turn[body1[m]], turn[body2[m]]
        arm1, arm2 = _turn(turn1, arms1[m]), _turn(turn2, arms2[m])
        d = _mean(x, nodes2[m], weights2[m]) + arm2 - _mean(x, nodes1[m], weights1[m]) - arm1
        r1 = _product(turn1, triads1[m])
        psi = _relative_vector(r1, _product(turn2, triads2[m]))
        angle = math.sqrt(psi[0] ** 2 + psi[1] ** 2 + psi[2] ** 2)
        tau = 0.25 if angle < 1e-6 else math.tan(0.25 * angle) / angle
        middle = _product(r1, _rotation(0.5 * psi))
        p = _turn(middle, psi)
        stretch, bend = _turn_back(middle, d) - rest[m], psi.copy()
        if viscosity > 0.0:
            spin1, spin2 = spin[body1[m]], spin[body2[m]]
            flow = _mean(v, nodes2[m], weights2[m]) - _mean(v, nodes1[m], weights1[m])
            flow += _cross(spin2, arm2) - _cross(spin1, arm1)
            difference = spin2 - spin1
            swing = 0.5 * (spin1 + spin2) - 0.5 * tau * _cross(p, difference)
            stretch += viscosity * _turn_back(middle, flow - _cross(swing, d))
            bend += viscosity * _swollen(psi, angle, _turn_back(middle, difference))
        n = _turn(middle, translation[m] * stretch)
        moment = _turn(middle, _swollen(psi, angle, rotation[m] * bend))
        h = _cross(n, d)
        twist = 0.5 * tau * _cross(h, p) - moment
        for k in range(one):
            out[m, k] = -weights1[m, k] * n
        out[m, one] = 0.5 * h + twist - _cross(arm1, n)
        for k in range(two):
            out[m, one + 1 + k] = weights2[m, k] * n
        out[m, -1] = 0.5 * h - twist + _cross(arm2, n)
    return out
