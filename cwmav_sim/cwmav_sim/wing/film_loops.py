# SPDX-License-Identifier: Apache-2.0
"""Triangles of film one by one: forces, tangent and energies of :mod:`cwmav_sim.wing.membrane`.

Loops run as :mod:`cwmav_sim.wing.arithmetic` says. Sums over the three components of Voigt order are written
as dot products of vectors; ``law`` is symmetric.
"""

from __future__ import annotations

from typing import NamedTuple

from cwmav_sim.wing.algebra import Vector, compiled, dot, inlined, plus, put, row, times
from cwmav_sim.wing.sheet import FloatArray, IntArray


class Triangles(NamedTuple):
    """Triangles of one film.

    Attributes
    ----------
    corners : ndarray, shape (m, 3)
        Node numbers.
    gradients : ndarray, shape (m, 3, 2)
        Gradients of the corners' shape functions in the reference plane [1/m].
    volume : ndarray, shape (m,)
        Volumes [m3].
    law : ndarray, shape (3, 3)
        Material law in Voigt order [Pa].
    viscosity : float
        Rayleigh coefficient a1 [s].
    """

    corners: IntArray
    gradients: FloatArray
    volume: FloatArray
    law: FloatArray
    viscosity: float


_Slope = tuple[Vector, Vector]  # derivative of a field along both directions of the reference plane


@inlined
def _slope(field: FloatArray, film: Triangles, m: int) -> _Slope:
    """Return the derivative of positions (F) or velocities within a triangle, by its two columns."""
    first = second = (0.0, 0.0, 0.0)
    for a in range(3):
        at = row(field, film.corners[m, a])
        first = plus(first, times(film.gradients[m, a, 0], at))
        second = plus(second, times(film.gradients[m, a, 1], at))
    return first, second


@inlined
def _strain(f: _Slope) -> Vector:
    """E = (F'F - I)/2."""
    return 0.5 * (dot(f[0], f[0]) - 1.0), 0.5 * (dot(f[1], f[1]) - 1.0), dot(f[0], f[1])


@inlined
def _strain_rate(f: _Slope, flow: _Slope) -> Vector:
    """Return the derivative of the strain where F changes at the rate ``flow``."""
    return dot(f[0], flow[0]), dot(f[1], flow[1]), dot(f[0], flow[1]) + dot(f[1], flow[0])


@inlined
def _stressing(v: FloatArray, film: Triangles, m: int, f: _Slope) -> Vector:
    """Stresses, elastic and viscous, times the volume [N m]."""
    strain = _strain(f)
    if film.viscosity > 0.0:
        strain = plus(strain, times(film.viscosity, _strain_rate(f, _slope(v, film, m))))
    return times(film.volume[m], _law(film, strain))


@inlined
def _law(film: Triangles, strain: Vector) -> Vector:
    law = film.law
    return dot(row(law, 0), strain), dot(row(law, 1), strain), dot(row(law, 2), strain)


@inlined
def _pull(f: _Slope, one: float, two: float, stress: Vector) -> Vector:
    """F S G of a corner whose shape function has the gradient (one, two)."""
    along = times(one * stress[0] + two * stress[2], f[0])
    return plus(along, times(one * stress[2] + two * stress[1], f[1]))


@compiled
def film_forces(
    first: int, last: int, x: FloatArray, v: FloatArray, film: Triangles, out: FloatArray
) -> None:
    """Fill in the resisting nodal forces of triangles [N], shape (m, 9)."""
    for m in range(first, last):
        f = _slope(x, film, m)
        stress = _stressing(v, film, m, f)
        for a in range(3):
            force = _pull(f, film.gradients[m, a, 0], film.gradients[m, a, 1], stress)
            for i in range(3):
                out[m, 3 * a + i] = force[i]


@compiled
def film_tangent(
    first: int,
    last: int,
    x: FloatArray,
    v: FloatArray,
    film: Triangles,
    rate: float,
    stressed_x: FloatArray,
    stressed_v: FloatArray,
    out: FloatArray,
) -> None:
    """Fill in d(forces)/dx + rate d(forces)/dv with the stresses of another state [N/m], shape (m, 9, 9).

    One column after the other: a corner moves by one along an axis, the strain changes, and so do the pulls
    on all corners; the stresses present turn with the film.
    """
    gain = 1.0 + film.viscosity * rate
    for m in range(first, last):
        f, flow = _slope(x, film, m), _slope(v, film, m)
        present = _stressing(stressed_v, film, m, _slope(stressed_x, film, m))
        for a in range(3):
            one, two = film.gradients[m, a, 0], film.gradients[m, a, 1]
            for j in range(3):
                change = plus(
                    times(gain, _variation(f, one, two, j)),
                    times(film.viscosity, _variation(flow, one, two, j)),
                )
                stress = times(film.volume[m], _law(film, change))
                for b in range(3):
                    own, other = film.gradients[m, b, 0], film.gradients[m, b, 1]
                    force = _pull(f, own, other, stress)
                    for i in range(3):
                        out[m, 3 * b + i, 3 * a + j] = force[i]
                    out[m, 3 * b + j, 3 * a + j] += own * (present[0] * one + present[2] * two) + other * (
                        present[2] * one + present[1] * two
                    )


@inlined
def _variation(f: _Slope, one: float, two: float, axis: int) -> Vector:
    """Change of the strain where a corner of gradient (one, two) moves by one along an axis."""
    first, second = f[0][axis], f[1][axis]
    return one * first, two * second, one * second + two * first


@compiled
def film_strain(first: int, last: int, x: FloatArray, film: Triangles, out: FloatArray) -> None:
    """Fill in Green-Lagrange strains (E11, E22, 2 E12), shape (m, 3)."""
    for m in range(first, last):
        put(out, m, _strain(_slope(x, film, m)))


@compiled
def film_energy(first: int, last: int, x: FloatArray, film: Triangles, out: FloatArray) -> None:
    """Fill in the strain energies [J], shape (m,)."""
    for m in range(first, last):
        strain = _strain(_slope(x, film, m))
        out[m] = 0.5 * film.volume[m] * dot(strain, _law(film, strain))


@compiled
def film_dissipation(
    first: int, last: int, x: FloatArray, v: FloatArray, film: Triangles, out: FloatArray
) -> None:
    """Fill in the viscous powers [W], shape (m,)."""
    for m in range(first, last):
        rate = _strain_rate(_slope(x, film, m), _slope(v, film, m))
        out[m] = film.viscosity * film.volume[m] * dot(rate, _law(film, rate))
