# SPDX-License-Identifier: Apache-2.0
"""Wall elements on bent sheets against the same formulas written with arrays."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cwmav_sim import case as cases
from cwmav_sim.sph.cells import make_grid, sort_into_cells
from cwmav_sim.sph.sheet import SheetQuadrature
from cwmav_sim.sph.surfaces import Sides, locate_surfaces


@pytest.fixture(scope="module")
def motion():
    return cases.preset("smoke").motion()


def quadrature(motion, set_back=0.0, dimensions=3):
    return SheetQuadrature(
        motion,
        spacing=0.006,
        probe_spacing=0.01,
        set_back=set_back,
        dimensions=dimensions,
        mirrored=dimensions == 3,
    )


@pytest.fixture(scope="module")
def bent(motion):
    rng = np.random.default_rng(4)
    state = motion.state(0.01)
    fields = (state.x, state.v, state.a)
    x, v, a = (f + s * rng.normal(size=f.shape) for f, s in zip(fields, (1e-3, 1.0, 100.0), strict=True))
    return replace(state, x=x, v=v, a=a)


def edges(motion, nodes):
    a, b, c = (nodes.x[motion.triangles[:, k]] for k in range(3))
    return b - a, c - a


def test_elements_lie_and_move_between_their_corners(motion, bent):
    q = quadrature(motion)
    placed, weights = q.place(bent), q.weights(len(bent.x))
    assert_allclose(placed.x, weights @ bent.x, atol=1e-15)
    assert_allclose(placed.v, weights @ bent.v, rtol=1e-12)
    along = np.sum((weights @ bent.a) * placed.normal, axis=1)
    assert_allclose(placed.normal_acceleration, along, rtol=1e-9, atol=1e-9)


def test_with_the_outline_set_outwards_the_elements_have_the_area_of_the_triangles(motion, bent):
    area = 0.5 * np.linalg.norm(np.cross(*edges(motion, bent)), axis=1)
    assert quadrature(motion, set_back=-0.01).place(bent).area.sum() == pytest.approx(area.sum(), rel=1e-12)


def test_normals_are_those_of_the_triangles_around_and_of_length_one(motion, bent):
    q = quadrature(motion)
    vector = 0.5 * np.cross(*edges(motion, bent))
    around = np.zeros_like(bent.x)
    for k in range(3):
        np.add.at(around, motion.triangles[:, k], vector)
    normal = q.weights(len(bent.x)) @ around
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    assert_allclose(q.place(bent).normal, normal, atol=1e-12)


def test_inward_directions_lie_in_the_sheet_and_turn_with_it(motion):
    q, rest = quadrature(motion, set_back=0.003), motion.state(0.0)
    before = q.place(rest)
    angle = 0.7
    turn = np.array(
        [[np.cos(angle), 0.0, np.sin(angle)], [0.0, 1.0, 0.0], [-np.sin(angle), 0.0, np.cos(angle)]]
    )
    after = q.place(replace(rest, x=rest.x @ turn.T, v=rest.v @ turn.T, a=rest.a @ turn.T))
    assert_allclose(np.linalg.norm(after.inward, axis=1), 1.0, atol=1e-12)
    assert_allclose(after.inward, before.inward @ turn.T, atol=1e-9)
    assert_allclose(after.normal, before.normal @ turn.T, atol=1e-9)
    assert_allclose(after.area, before.area, rtol=1e-9)


def test_in_two_dimensions_everything_lies_in_the_plane(motion, bent):
    placed = quadrature(motion, dimensions=2).place(bent)
    for values in (placed.x, placed.v, placed.normal, placed.inward):
        assert not values[:, 1].any()
    assert_allclose(np.linalg.norm(placed.normal, axis=1), 1.0, atol=1e-12)


def test_a_panel_of_which_the_set_back_leaves_nothing_is_out_of_reach():
    """Two panels, one of them narrower than twice the set-back."""
    wide = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.1, 0.1, 0.0]])
    narrow = np.array([[0.0, 0.0, 0.05], [0.004, 0.0, 0.05], [0.0, 0.004, 0.05], [0.004, 0.004, 0.05]])
    nodes = SimpleNamespace(x=np.concatenate([wide, narrow]), v=np.zeros((8, 3)), a=np.zeros((8, 3)))
    triangles = np.array([[0, 1, 2], [1, 3, 2], [4, 5, 6], [5, 7, 6]])
    two = SimpleNamespace(
        triangles=triangles,
        panel=np.array([0, 0, 1, 1]),
        panel_names=("wide", "narrow"),
        state=lambda _: nodes,
    )
    q = SheetQuadrature(two, spacing=0.004, probe_spacing=0.006, set_back=0.01, dimensions=3, mirrored=False)
    assert set(q.panel) == {0}
    grid = make_grid(np.full(3, -0.1), np.full(3, 0.3), 0.018, mirrored=False, dimensions=3)
    sorting = sort_into_cells(np.array([[0.05, 0.05, 0.01], [0.002, 0.002, 0.051]]), grid)
    fluid = np.ascontiguousarray(sorting.local.T)
    found = locate_surfaces(q, q.place(nodes), grid, fluid, sorting.column.astype(float), sorting.start)
    own = found.particle_sides.in_storage_order(2, sorting.order, sorting.start, found.near_any)
    assert own.signed[0, 0] == pytest.approx(0.01)
    assert not own.signed[1].any()


def test_sides_in_another_order_stay_row_by_row():
    """A loop is compiled once for every layout of memory."""
    draw = np.random.default_rng(2)
    sides = Sides(draw.normal(size=(2, 9)), draw.normal(size=(2, 9)), draw.normal(size=(2, 3, 9)))
    places = draw.permutation(9)
    taken = sides.take(places)
    for name in ("signed", "inside", "normal"):
        values = getattr(taken, name)
        assert values.flags.c_contiguous
        assert (values == getattr(sides, name)[..., places]).all()
