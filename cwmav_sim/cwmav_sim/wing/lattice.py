# SPDX-License-Identifier: Apache-2.0
"""The quasi-flexible wing of the paper: rigid facets, ball joints, linear springs in place of the veins.

Neighbouring facets are joined at the middle of their common edge, of length w, with their centres l apart:

* a ball joint holds them together normal to the film and leaves every relative rotation free but for the
  film's own bending stiffness, D w/l with D = E t^3/(12 (1 - nu^2));
* linear springs replace the film in its plane: E t w/l from centre to centre, G t w/l across that, and
  E t w^3/(12 l) against turning in the plane.

Where a rod crosses from one facet to the next, a second joint carries it: EA/L along the rod, a ball joint
across it, and angular springs GJ/L, EI/L, with L the distance between the middles of the rod's two pieces.
The paper states no constants; these make the lattice the discrete counterpart of film and rods, and
two scales adjust them. Joints are elastic rather than rigid constraints: the implicit integrator takes any
stiffness, light facets included, and no drift needs correction.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from cwmav_sim.wing.carried import CarriedAir, body_blocks
from cwmav_sim.wing.connector import Connectors, Ends, Stiffness
from cwmav_sim.wing.dynamics import System
from cwmav_sim.wing.facets import Facets, FacetSheet, group_triangles, rigid_facets
from cwmav_sim.wing.flexible import Plan, locate, stiffener_path
from cwmav_sim.wing.hinge import Held, HingedRoot
from cwmav_sim.wing.parts import Inertia
from cwmav_sim.wing.rods import Section, straight_rod
from cwmav_sim.wing.rotation import turn, turn_back
from cwmav_sim.wing.sheet import FloatArray, IntArray
from cwmav_sim.wing.structure import FlexibleWings

_GROUND = 1e-12  # mass [kg] and inertia [kg m2] of the driven ground bodies, which never accelerate freely
_FINE = 4  # rod samples per mesh spacing
_NEIGHBOURS = 3  # joints that hold a facet
_NARROW = 0.05  # common edges narrower than this share of the distance of centres carry no joint
_NORMAL = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Joint:
    """One joint of a panel, in hinge coordinates; ``first`` and ``second`` are body numbers."""

    first: int
    second: int
    point: FloatArray
    triad: FloatArray
    translation: FloatArray
    rotation: FloatArray
    rest: FloatArray


@dataclass(frozen=True)
class _Run:
    """A stretch of a rod on one facet: from where to where, and how long."""

    facet: int
    start: FloatArray
    end: FloatArray
    length: float


def lattice_wings(layout: Plan) -> FlexibleWings:
    """Build the quasi-flexible wings; every panel starts flat and at rest in the middle of its stroke.

    Body rows of a panel: its facets, then the ground bodies that hold the spar and the trailing-edge corner.
    """
    axes = layout.hinges.at(0.0).axes
    facets, grounds, joints = lattice_panel(layout)
    centre = np.concatenate([facets.centre, grounds])
    frames = np.concatenate([facets.axes, np.broadcast_to(np.eye(3), (len(grounds), 3, 3))])
    count = len(centre)
    x = np.concatenate([turn(a, centre) for a in axes])
    rotation = np.concatenate([_proper(a @ frames) for a in axes])
    mass = np.concatenate([facets.mass, np.full(len(grounds), _GROUND)])
    inertia = np.concatenate([facets.inertia, np.full((len(grounds), 3), _GROUND)])
    system = System(
        Inertia(np.tile(mass, len(axes)), np.tile(inertia, (len(axes), 1))),
        [_connectors(layout, joints, x, rotation, axes, count)],
        _root(layout, len(facets.mass), grounds, rotation, count),
        mass_damping=layout.flexibility.damping.mass,
        carried=CarriedAir(body_blocks(len(x))),
    )
    return FlexibleWings(
        system,
        _sheet(layout, facets, system, x, rotation, axes, count),
        layout.triangles,
        layout.panel,
        layout.names,
        layout.flexibility.integration,
        x,
        rotation,
        contact=layout.flexibility.contact,
    )


def lattice_panel(layout: Plan) -> tuple[Facets, FloatArray, list[Joint]]:
    """Return facets, places of the ground bodies and joints of one panel, in hinge coordinates."""
    size = layout.flexibility.lattice
    grouped = group_triangles(layout.mesh, layout.planform, size.spanwise, size.chordwise)
    grouped = _without_flaps(layout, grouped)
    rods = _rods(layout, grouped)
    facets = _facets(layout, grouped, rods)
    root = layout.planform.root
    grounds = [np.array([root, 0.0, 0.0])]
    joints = [joint for section, runs in rods for joint in _rod_joints(layout, section, runs)]
    joints += _film_joints(layout, facets, {(min(j.first, j.second), max(j.first, j.second)) for j in joints})
    spar, runs = rods[0]
    joints.append(_spar_clamp(layout, spar, runs[0], len(facets.mass)))
    if layout.flexibility.root.trailing_edge != "free":
        corner = np.array([root, layout.planform.root_chord, 0.0])
        facet = int(grouped[locate(corner[None, :2], layout.mesh)[0][0]])
        hold = np.full(3, layout.flexibility.lattice.ball_joint)
        ground = len(facets.mass) + len(grounds)
        joints.append(Joint(ground, facet, corner, np.eye(3), hold, np.zeros(3), np.zeros(3)))
        grounds.append(corner)
    return facets, np.array(grounds), joints


def _without_flaps(layout: Plan, grouped: IntArray) -> IntArray:
    """Merge facets with fewer than three neighbours, which nothing would keep from flapping over.

    A facet on two ball joints turns freely about the line through them. Each goes to the neighbour with the
    widest common edge; the root facets, which the spar's clamp and the body hold, stay.
    """
    x = layout.flat
    root = set(grouped[np.any(layout.mesh.r[layout.mesh.triangles] == layout.planform.root, axis=1)].tolist())
    while True:
        widths: dict[int, dict[int, float]] = {int(f): {} for f in np.unique(grouped)}
        for (one, two), edges in _common_edges(layout.mesh.triangles, grouped).items():
            ends = x[np.array(edges)]
            width = float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum())
            widths[one][two] = widths[two][one] = width
        flaps = [f for f, near in widths.items() if 0 < len(near) < _NEIGHBOURS and f not in root]
        if not flaps or len(widths) <= _NEIGHBOURS:
            return np.unique(grouped, return_inverse=True)[1].astype(np.int64)
        near = widths[flaps[0]]
        grouped = np.where(grouped == flaps[0], max(near, key=near.__getitem__), grouped)


def _rods(layout: Plan, grouped: IntArray) -> list[tuple[Section, list[_Run]]]:
    """Every rod, spar first, cut into runs that lie on one facet each."""
    planform, flexibility = layout.planform, layout.flexibility
    fine = layout.spacing / _FINE
    count = max(2, round((planform.length - planform.root) / fine))
    leading = np.zeros((count + 1, 2))
    leading[:, 0] = np.linspace(planform.root, planform.length, count + 1)
    lines = [(flexibility.spar.section(), leading)]
    lines += [(s.section(), stiffener_path(s, planform, fine)) for s in flexibility.stiffeners]
    rods = []
    for section, path in lines:
        triangle, _ = locate(0.5 * (path[1:] + path[:-1]), layout.mesh)
        facet = grouped[triangle]
        ends = np.flatnonzero(np.diff(facet)) + 1
        stops = np.concatenate([[0], ends, [len(facet)]])
        runs = [
            _Run(int(facet[i]), path[i], path[j], float(np.linalg.norm(path[j] - path[i])))
            for i, j in itertools.pairwise(stops)
        ]
        rods.append((section, runs))
    return rods


def _facets(layout: Plan, grouped: IntArray, rods: list[tuple[Section, list[_Run]]]) -> Facets:
    """Rigid facets with the mass of film (at the edges' middles, exact to second moments) and rods."""
    film, flat = layout.flexibility.film, layout.flat
    corner = flat[layout.mesh.triangles]
    area = 0.5 * np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    middles = 0.5 * (corner + np.roll(corner, 1, axis=1))
    places, masses = [middles.reshape(-1, 3)], [np.repeat(film.density * film.thickness * area / 3.0, 3)]
    at = [np.repeat(grouped, 3)]
    for section, runs in rods:
        for run in runs:
            offset = 0.5 / np.sqrt(3.0)  # two points with the second moment of the run
            share = np.array([[0.5 - offset], [0.5 + offset]])
            pair = run.start + share * (run.end - run.start)
            places.append(np.concatenate([pair, np.zeros((2, 1))], axis=1))
            masses.append(np.full(2, 0.5 * section.line_mass * run.length))
            at.append(np.full(2, run.facet))
    return rigid_facets(grouped, np.concatenate(places), np.concatenate(masses), np.concatenate(at))


def _film_joints(layout: Plan, facets: Facets, with_rod: set[tuple[int, int]]) -> list[Joint]:
    """Joints at common edges; a pair ``with_rod`` is already held together normal to the film there.

    A second ball joint on the same edge would make it a hinge and forbid the twist of one facet against
    the next.
    """
    mesh, film, size = layout.mesh, layout.flexibility.film, layout.flexibility.lattice
    centroid = _centroids(layout, facets.of_triangle)
    membrane = size.spring_scale * film.modulus * film.thickness
    shear = membrane / (2.0 * (1.0 + film.poisson))
    bending = film.modulus * film.thickness**3 / (12.0 * (1.0 - film.poisson**2))
    slack = np.array([film.slack_span, film.slack_chord, 0.0])
    joints = []
    for (one, two), edges in _common_edges(mesh.triangles, facets.of_triangle).items():
        ends = layout.flat[np.array(edges)]
        offset = centroid[two] - centroid[one]
        reach = float(np.linalg.norm(offset))
        triad = _joint_triad(offset / reach)
        length = np.abs((ends[:, 1] - ends[:, 0]) @ triad[:, 1])  # a ragged edge counts by its projection
        width = float(length.sum())
        if width < _NARROW * reach:
            continue
        point = np.sum(length[:, None] * ends.mean(axis=1), axis=0) / width
        ratio = width / reach
        normal = 0.0 if (one, two) in with_rod else size.ball_joint
        translation = np.array([membrane * ratio, shear * ratio, normal])
        rotation = np.array([bending * ratio, bending * ratio, membrane * width**2 * ratio / 12.0])
        joints.append(Joint(one, two, point, triad, translation, rotation, triad.T @ (slack * offset)))
    return joints


def _centroids(layout: Plan, of_triangle: IntArray) -> FloatArray:
    corner = layout.flat[layout.mesh.triangles].mean(axis=1)
    count = np.bincount(of_triangle)
    return np.stack([np.bincount(of_triangle, corner[:, k]) / count for k in range(3)], axis=1)


def _common_edges(triangles: IntArray, facet: IntArray) -> dict[tuple[int, int], list[tuple[int, int]]]:
    """Mesh edges between two facets, by the pair of facets."""
    owner: dict[tuple[int, int], int] = {}
    common: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for triangle, own in zip(triangles.tolist(), facet.tolist(), strict=True):
        for k in range(3):
            edge = (min(triangle[k], triangle[k - 1]), max(triangle[k], triangle[k - 1]))
            other = owner.setdefault(edge, own)
            if other != own:
                common.setdefault((min(own, other), max(own, other)), []).append(edge)
    return common


def _joint_triad(across: FloatArray) -> FloatArray:
    """Axes of a joint: from centre to centre, along the edge, normal to the film."""
    return np.stack([across, np.cross(_NORMAL, across), _NORMAL], axis=1)


def _rod_joints(layout: Plan, section: Section, runs: list[_Run]) -> list[Joint]:
    joints = []
    for before, after in itertools.pairwise(runs):
        length = 0.5 * (before.length + after.length)
        triad = _rod_triad(before.start, after.end)
        point = np.append(after.start, 0.0)
        joints.append(_rod_joint(layout, section, before.facet, after.facet, point, triad, length))
    return joints


def _spar_clamp(layout: Plan, section: Section, run: _Run, ground: int) -> Joint:
    """Joint of the spar's first piece with the hinge."""
    triad = _rod_triad(run.start, run.end)
    return _rod_joint(layout, section, ground, run.facet, np.append(run.start, 0.0), triad, 0.5 * run.length)


def _rod_triad(start: FloatArray, end: FloatArray) -> FloatArray:
    return straight_rod(np.array([[*start, 0.0], [*end, 0.0]]), _NORMAL)


def _rod_joint(
    layout: Plan,
    section: Section,
    first: int,
    second: int,
    point: FloatArray,
    triad: FloatArray,
    length: float,
) -> Joint:
    size = layout.flexibility.lattice
    translation = np.array([section.translation[0] / length, size.ball_joint, size.ball_joint])
    rotation = size.joint_scale * section.rotation / length * np.array([size.rod_torsion, 1.0, 1.0])
    return Joint(first, second, point, triad, translation, rotation, np.zeros(3))


def _connectors(
    layout: Plan, joints: list[Joint], x: FloatArray, rotation: FloatArray, axes: FloatArray, count: int
) -> Connectors:
    """Joints of all panels; arms and triads in the material axes of their bodies."""
    ends: list[list[Ends]] = [[], []]
    for k, frame in enumerate(axes):
        point = turn(frame, np.array([j.point for j in joints]))
        triad = _proper(frame @ np.array([j.triad for j in joints]))
        for side, numbers in enumerate(([j.first for j in joints], [j.second for j in joints])):
            body = np.array(numbers, dtype=np.int64) + k * count
            arm = turn_back(rotation[body], point - x[body])
            own = np.swapaxes(rotation[body], 1, 2) @ triad
            ends[side].append(Ends(body[:, None], np.ones((len(body), 1)), body, arm, own))
    first, second = (Ends(*(np.concatenate([getattr(e, f) for e in s]) for f in _FIELDS)) for s in ends)
    panels = len(axes)
    stiffness = Stiffness(
        np.tile([j.translation for j in joints], (panels, 1)),
        np.tile([j.rotation for j in joints], (panels, 1)),
        np.tile([j.rest for j in joints], (panels, 1)),
    )
    viscosity = layout.flexibility.damping.stiffness
    return Connectors(first, second, stiffness, len(x), viscosity=viscosity)


_FIELDS = Ends._fields


def _proper(frames: FloatArray) -> FloatArray:
    """Turn left-handed frames, which mirrored panels have, into rotations by reversing their last axis."""
    out = frames.copy()
    out[..., 2] *= np.sign(np.linalg.det(frames))[..., None]
    return out


def _sheet(
    layout: Plan,
    facets: Facets,
    system: System,
    x: FloatArray,
    rotation: FloatArray,
    axes: FloatArray,
    count: int,
) -> FacetSheet:
    pairs = np.unique(
        np.stack([layout.mesh.triangles.ravel(), np.repeat(facets.of_triangle, 3)], axis=1), axis=0
    )
    nodes, bodies, arms = [], [], []
    for k, frame in enumerate(axes):
        body = pairs[:, 1] + k * count
        nodes.append(pairs[:, 0] + k * len(layout.mesh.r))
        bodies.append(body)
        arms.append(turn_back(rotation[body], turn(frame, layout.flat[pairs[:, 0]]) - x[body]))
    return FacetSheet(system, np.concatenate(nodes), np.concatenate(bodies), np.concatenate(arms))


def _root(layout: Plan, facets: int, grounds: FloatArray, rotation: FloatArray, count: int) -> HingedRoot:
    panels = np.arange(len(layout.panels), dtype=np.int64)
    number = (count * panels[:, None] + facets + np.arange(len(grounds))).ravel()
    swings = np.array([True, layout.flexibility.root.trailing_edge == "hinge"])[: len(grounds)]
    group = np.repeat(panels, len(grounds))
    held = Held(number, group, np.tile(grounds, (len(panels), 1)), np.tile(swings, len(panels)))
    rows = np.tile(np.repeat(panels, count), 2)
    return HingedRoot(layout.hinges, held, number, group, rotation[number], rows)
