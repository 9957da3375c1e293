# SPDX-License-Identifier: Apache-2.0
"""Connectors one by one: forces, tangent and energies of :mod:`cwmav_sim.wing.connector`.

Loops run as :mod:`cwmav_sim.wing.arithmetic` says.
"""

from __future__ import annotations

from typing import NamedTuple

from cwmav_sim.wing.algebra import (
    Vector,
    across,
    compiled,
    dot,
    each,
    inlined,
    minus,
    plus,
    row,
    times,
    turned,
    turned_back,
    unit,
)
from cwmav_sim.wing.connector_shape import (
    Ends,
    Shape,
    Stiffness,
    middle_spin,
    resultants,
    shape_of,
    strain_rates,
    swollen,
)
from cwmav_sim.wing.sheet import FloatArray

_Loads = tuple[Vector, Vector, Vector]  # the force between the ends, the moments on both bodies


@inlined
def _spread(out: FloatArray, m: int, one: Ends, two: Ends, loads: _Loads) -> None:
    """Write what a connector does to the nodes and bodies of its ends."""
    force, first, second = loads
    bodies1, bodies2 = one.nodes.shape[1], one.nodes.shape[1] + 1 + two.nodes.shape[1]
    for i in range(3):
        for k in range(one.nodes.shape[1]):
            out[m, k, i] = -one.weights[m, k] * force[i]
        out[m, bodies1, i] = first[i]
        for k in range(two.nodes.shape[1]):
            out[m, bodies1 + 1 + k, i] = two.weights[m, k] * force[i]
        out[m, bodies2, i] = second[i]


@compiled
def connector_forces(
    first: int,
    last: int,
    x: FloatArray,
    v: FloatArray,
    turn: FloatArray,
    spin: FloatArray,
    one: Ends,
    two: Ends,
    stiffness: Stiffness,
    viscosity: float,
    out: FloatArray,
) -> None:
    """Fill in the forces and moments on both ends' nodes and bodies, shape (m, w1 + 1 + w2 + 1, 3)."""
    for m in range(first, last):
        s = shape_of(x, turn, one, two, m)
        force, moment = resultants(v, spin, one, two, stiffness, viscosity, m, s)
        n = turned(s.middle, force)
        h = across(n, s.d)
        twist = minus(times(0.5 * s.tau, across(h, s.p)), turned(s.middle, swollen(s, moment)))
        moment1 = minus(plus(times(0.5, h), twist), across(s.arm1, n))
        moment2 = plus(minus(times(0.5, h), twist), across(s.arm2, n))
        _spread(out, m, one, two, (n, moment1, moment2))


class _Present(NamedTuple):
    """What a connector bears, in space, and the springs of its tangent."""

    n: Vector
    h: Vector
    moment: Vector
    translation: Vector
    rotation: Vector


@compiled
def _response(
    s: Shape, present: _Present, apart: Vector, w1: Vector, w2: Vector
) -> tuple[Vector, Vector, Vector]:
    """Change of the force and of both moments where the ends part by ``apart`` and the bodies turn.

    The equations of the forces, differentiated term by term; ``d_tau`` and ``dS`` are left out.
    """
    n, delta = present.n, minus(w2, w1)
    middle = middle_spin(s, w1, w2)
    d_d = plus(apart, minus(across(w2, s.arm2), across(w1, s.arm1)))
    strain = each(present.translation, turned_back(s.middle, plus(d_d, across(s.d, middle))))
    d_n = minus(turned(s.middle, strain), across(n, middle))
    d_h = minus(across(n, d_d), across(s.d, d_n))
    bend = swollen(s, turned_back(s.middle, delta))
    elastic = turned(s.middle, swollen(s, each(present.rotation, bend)))
    d_moment = minus(elastic, across(present.moment, middle))
    d_p = minus(turned(s.middle, bend), across(s.p, middle))
    d_twist = times(0.5 * s.tau, minus(across(present.h, d_p), across(s.p, d_h)))
    twist = minus(d_twist, d_moment)
    first = plus(across(s.arm1, d_n), across(n, across(s.arm1, w1)))
    second = plus(across(s.arm2, d_n), across(n, across(s.arm2, w2)))
    return d_n, minus(plus(times(0.5, d_h), twist), first), plus(minus(times(0.5, d_h), twist), second)


@compiled
def connector_tangent(
    first: int,
    last: int,
    x: FloatArray,
    turn: FloatArray,
    one: Ends,
    two: Ends,
    stiffness: Stiffness,
    viscosity: float,
    rate: float,
    stressed_x: FloatArray,
    stressed_v: FloatArray,
    stressed_turn: FloatArray,
    stressed_spin: FloatArray,
    out: FloatArray,
) -> None:
    """Fill in the tangent with force and moment of another state, shape (m, r, 3, r, 3), r = w1 + w2 + 2.

    One column after the other: the ends part along an axis, or a body turns about it.
    """
    width1, width2 = one.nodes.shape[1], two.nodes.shape[1]
    gain, still = 1.0 + viscosity * rate, (0.0, 0.0, 0.0)
    for m in range(first, last):
        s = shape_of(x, turn, one, two, m)
        borne = shape_of(stressed_x, stressed_turn, one, two, m)
        force, moment = resultants(stressed_v, stressed_spin, one, two, stiffness, viscosity, m, borne)
        n = turned(s.middle, force)
        present = _Present(
            n,
            across(n, s.d),
            turned(s.middle, swollen(s, moment)),
            times(gain, row(stiffness.translation, m)),
            times(gain, row(stiffness.rotation, m)),
        )
        for j in range(3):
            parted = _response(s, present, unit(j), still, still)
            for k in range(width1):
                _put_column(out, m, k, j, -one.weights[m, k], one, two, parted)
            for k in range(width2):
                _put_column(out, m, width1 + 1 + k, j, two.weights[m, k], one, two, parted)
            _put_column(out, m, width1, j, 1.0, one, two, _response(s, present, still, unit(j), still))
            turning = _response(s, present, still, still, unit(j))
            _put_column(out, m, width1 + 1 + width2, j, 1.0, one, two, turning)


@compiled
def _put_column(
    out: FloatArray, m: int, k: int, j: int, factor: float, one: Ends, two: Ends, loads: _Loads
) -> None:
    """Write the column of unknown ``j`` of row ``k``: ``factor`` times what these loads do, spread."""
    force, first, second = loads
    bodies1, bodies2 = one.nodes.shape[1], one.nodes.shape[1] + 1 + two.nodes.shape[1]
    for i in range(3):
        for r in range(one.nodes.shape[1]):
            out[m, r, i, k, j] = factor * (-one.weights[m, r] * force[i])
        out[m, bodies1, i, k, j] = factor * first[i]
        for r in range(two.nodes.shape[1]):
            out[m, bodies1 + 1 + r, i, k, j] = factor * (two.weights[m, r] * force[i])
        out[m, bodies2, i, k, j] = factor * second[i]


@compiled
def _doubled_energy(stiffness: Stiffness, m: int, stretch: Vector, bend: Vector) -> float:
    """Sum of k_t stretch^2 and k_r bend^2."""
    pulled = dot(each(row(stiffness.translation, m), stretch), stretch)
    return pulled + dot(each(row(stiffness.rotation, m), bend), bend)


@compiled
def connector_energy(
    first: int,
    last: int,
    x: FloatArray,
    turn: FloatArray,
    one: Ends,
    two: Ends,
    stiffness: Stiffness,
    out: FloatArray,
) -> None:
    """Fill in the elastic energies [J], shape (m,)."""
    for m in range(first, last):
        s = shape_of(x, turn, one, two, m)
        stretch = minus(turned_back(s.middle, s.d), row(stiffness.rest, m))
        out[m] = 0.5 * _doubled_energy(stiffness, m, stretch, s.psi)


@compiled
def connector_dissipation(
    first: int,
    last: int,
    x: FloatArray,
    v: FloatArray,
    turn: FloatArray,
    spin: FloatArray,
    one: Ends,
    two: Ends,
    stiffness: Stiffness,
    viscosity: float,
    out: FloatArray,
) -> None:
    """Fill in the viscous powers [W], shape (m,)."""
    for m in range(first, last):
        stretching, bending = strain_rates(v, spin, one, two, m, shape_of(x, turn, one, two, m))
        out[m] = viscosity * _doubled_energy(stiffness, m, stretching, bending)
