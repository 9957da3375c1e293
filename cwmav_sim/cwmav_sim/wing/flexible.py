# SPDX-License-Identifier: Apache-2.0
"""Settings of the flexible wing, and the wing as film and carbon rods."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from cwmav_common.errors import InputError
from cwmav_common.settings import setting
from cwmav_sim.kinematics import Kinematics
from cwmav_sim.wing.carried import CarriedAir, node_blocks
from cwmav_sim.wing.contact import ContactLaw
from cwmav_sim.wing.dynamics import System
from cwmav_sim.wing.film_mesh import even_mesh
from cwmav_sim.wing.geometry import PanelMesh, WingPlanform
from cwmav_sim.wing.hinge import Held, HingedRoot, Hinges, Panel, panels
from cwmav_sim.wing.integrate import Integration
from cwmav_sim.wing.membrane import Membrane, lumped_mass, plane_stress
from cwmav_sim.wing.parts import Inertia
from cwmav_sim.wing.prescribed import Attitude
from cwmav_sim.wing.rods import RodPath, Spar, Stiffener, rod_elements, straight_rod
from cwmav_sim.wing.rotation import turn
from cwmav_sim.wing.sheet import FloatArray, IntArray
from cwmav_sim.wing.sheet_map import NodesAreSheet
from cwmav_sim.wing.structure import FlexibleWings


@dataclass(frozen=True)
class Film:
    """The film between the rods."""

    thickness: float = setting(1.0e-5, "thickness of the film", unit="m", gt=0)
    density: float = setting(920.0, "density of the film", unit="kg/m3", gt=0)
    modulus: float = setting(2.0e8, "Young's modulus of the film", unit="Pa", gt=0)
    poisson: float = setting(0.3, "Poisson's ratio of the film", ge=0, lt=0.5)
    slack_span: float = setting(0.0, "spare film along the span, over the span", ge=-0.05, le=0.2)
    slack_chord: float = setting(0.0, "spare film along the chord, over the chord", ge=-0.05, le=0.2)


@dataclass(frozen=True)
class Root:
    """How the inner end of a panel is held; the spar always swings with the hinge."""

    trailing_edge: str = setting(
        "body",
        "trailing-edge corner of the film: held by the body at mid-stroke, swinging with the hinge, or free",
        choices=("body", "hinge", "free"),
    )


@dataclass(frozen=True)
class Damping:
    """Rayleigh damping, equal to ``ratio`` at two frequencies."""

    ratio: float = setting(0.02, "damping ratio at both frequencies", ge=0, lt=1)
    low: float = setting(15.0, "lower frequency", unit="Hz", gt=0)
    high: float = setting(150.0, "higher frequency", unit="Hz", gt=0)

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise InputError(f"damping: low {self.low:g} Hz, high {self.high:g} Hz; allowed: low < high")

    @property
    def mass(self) -> float:
        """Coefficient a0 of the part proportional to mass [1/s]."""
        return 4.0 * math.pi * self.ratio * self.low * self.high / (self.low + self.high)

    @property
    def stiffness(self) -> float:
        """Coefficient a1 of the part proportional to stiffness [s]."""
        return self.ratio / (math.pi * (self.low + self.high))


@dataclass(frozen=True)
class LatticeLayout:
    """Facets and joints of the quasi-flexible wing."""

    spanwise: int = setting(8, "rows of facets along the span", ge=1, le=200)
    chordwise: int = setting(5, "facets along the chord", ge=1, le=200)
    ball_joint: float = setting(
        2.0e4, "stiffness of a ball joint against parting normal to the film", unit="N/m", gt=0
    )
    spring_scale: float = setting(1.0, "scale of the linear springs that stand for the film", gt=0)
    joint_scale: float = setting(1.0, "scale of the angular springs that stand for the rods", gt=0)
    rod_torsion: float = setting(
        0.0, "share of the rods' torsion stiffness that facets feel (0: film hinged on its rods)", ge=0, le=1
    )


@dataclass(frozen=True)
class Flexibility:
    """Structure of the wings; defaults describe a DelFly-like panel."""

    film: Film = field(default_factory=Film)
    spar: Spar = field(default_factory=Spar)
    stiffeners: tuple[Stiffener, ...] = setting(
        (Stiffener(0.10, 0.0, 0.60, 1.0), Stiffener(0.45, 0.0, 0.85, 0.90)), "round rods under the film"
    )
    root: Root = field(default_factory=Root)
    damping: Damping = field(default_factory=Damping)
    lattice: LatticeLayout = field(default_factory=LatticeLayout)
    contact: ContactLaw = field(default_factory=ContactLaw)
    integration: Integration = field(default_factory=Integration)


@dataclass(frozen=True)
class Plan:
    """What every model of a wing starts from: planform, mesh, panels and hinges."""

    flexibility: Flexibility
    planform: WingPlanform
    mesh: PanelMesh
    panels: tuple[Panel, ...]
    hinges: Hinges
    spacing: float

    @property
    def triangles(self) -> IntArray:
        """Triangles of all panels, shape (m, 3)."""
        count = len(self.mesh.r)
        return np.concatenate([self.mesh.triangles + k * count for k in range(len(self.panels))])

    @property
    def panel(self) -> IntArray:
        """Panel of every triangle, shape (m,)."""
        return np.repeat(np.arange(len(self.panels), dtype=np.int64), len(self.mesh.triangles))

    @property
    def node_panel(self) -> IntArray:
        """Panel of every node, shape (n,)."""
        return np.repeat(np.arange(len(self.panels), dtype=np.int64), len(self.mesh.r))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the panels."""
        return tuple(p.name for p in self.panels)

    @property
    def flat(self) -> FloatArray:
        """Unloaded nodes of one panel in hinge coordinates, shape (n, 3)."""
        return np.stack([self.mesh.r, self.mesh.s, np.zeros(len(self.mesh.r))], axis=1)

    def placed(self, axes: FloatArray) -> FloatArray:
        """Return the unloaded nodes of all panels in hinge frames ``axes`` (g, 3, 3), shape (n, 3)."""
        return np.concatenate([turn(a, self.flat) for a in axes])


def plan(
    flexibility: Flexibility,
    planform: WingPlanform,
    kinematics: Kinematics,
    attitude: Attitude,
    *,
    spacing: float,
    half: bool,
    moving: bool = True,
) -> Plan:
    """Lay out the panels of flapping wings; parameters as for :class:`ClappingWings`."""
    sides = panels(half)
    hinges = Hinges(kinematics, attitude.frequency, attitude.angle_of_attack, sides, moving)
    return Plan(flexibility, planform, even_mesh(planform, spacing), sides, hinges, spacing)


def membrane_wings(layout: Plan) -> FlexibleWings:
    """Build wings of film and rods; every panel starts flat and at rest in the middle of its stroke.

    Node rows: the mesh of each panel in turn. Body rows: the points of each panel's rods, spar first.
    """
    flexibility, mesh = layout.flexibility, layout.mesh
    axes = layout.hinges.at(0.0).axes
    count, total = len(mesh.r), len(mesh.r) * len(layout.panels)
    film = _film(layout)
    x = layout.placed(axes)
    rods, bodies = [], []
    for k, frame in enumerate(axes):
        rods.append(panel_rods(layout, frame, first_node=k * count))
        bodies.append(sum(len(path.points) for path in rods[-1]))
    paths = [path for panel in rods for path in panel]
    viscosity = flexibility.damping.stiffness
    system = System(
        _inertia(layout, film, paths, total),
        [film, rod_elements(paths, 0, total, viscosity=viscosity)],
        _root(layout, axes, bodies, [panel[0].triad for panel in rods]),
        mass_damping=flexibility.damping.mass,
        carried=CarriedAir(node_blocks(total)),
    )
    triads = np.concatenate([np.broadcast_to(p.triad, (len(p.points), 3, 3)) for p in paths])
    return FlexibleWings(
        system,
        NodesAreSheet(system),
        layout.triangles,
        layout.panel,
        layout.names,
        flexibility.integration,
        x,
        triads,
        contact=flexibility.contact,
    )


def panel_rods(layout: Plan, axes: FloatArray, *, first_node: int) -> list[RodPath]:
    """Lay spar and stiffeners of one panel, whose hinge frame is ``axes`` (3, 3)."""
    mesh, planform = layout.mesh, layout.planform
    edge = np.flatnonzero(mesh.s == 0.0)
    edge = edge[np.argsort(mesh.r[edge])]
    nodes = np.repeat(edge[:, None], 3, axis=1)
    weights = np.zeros((len(edge), 3))
    weights[:, 0] = 1.0
    placed = [(nodes, weights, layout.flexibility.spar.section())]
    for stiffener in layout.flexibility.stiffeners:
        triangle, shares = locate(stiffener_path(stiffener, planform, layout.spacing), mesh)
        placed.append((mesh.triangles[triangle], shares, stiffener.section()))
    rods = []
    for nodes, weights, section in placed:
        flat = np.einsum("pw,pwi->pi", weights, layout.flat[nodes])
        points = turn(axes, flat)
        rods.append(RodPath(nodes + first_node, weights, points, straight_rod(points, axes[:, 2]), section))
    return rods


def stiffener_path(stiffener: Stiffener, planform: WingPlanform, spacing: float) -> FloatArray:
    """Return points about ``spacing`` [m] apart along a stiffener, as (r, s), clipped to the film.

    Raises
    ------
    InputError
        The stiffener has no length on the film.
    """
    spans = np.array([stiffener.from_span, stiffener.to_span]) * planform.length
    shares = np.array([stiffener.from_chord, stiffener.to_chord])
    ends = np.stack([spans, shares * planform.chord(spans)], axis=1)
    if ends[0, 0] > ends[1, 0]:
        ends = ends[::-1]
    if ends[0, 0] < planform.root < ends[1, 0]:
        share = (planform.root - ends[0, 0]) / (ends[1, 0] - ends[0, 0])
        ends[0] = ends[0] + share * (ends[1] - ends[0])
    length = float(np.linalg.norm(ends[1] - ends[0]))
    if ends[0, 0] < planform.root or length <= 0.0:
        raise InputError(
            f"stiffener from r/R = {stiffener.from_span:g} to {stiffener.to_span:g} has no length on film, "
            f"which begins at r/R = {planform.root / planform.length:g}"
        )
    count = max(2, round(length / spacing))
    return np.asarray(ends[0] + np.linspace(0.0, 1.0, count + 1)[:, None] * (ends[1] - ends[0]))


def locate(points: FloatArray, mesh: PanelMesh) -> tuple[IntArray, FloatArray]:
    """Find the triangle around each point (r, s): its number (p,) and the shares of its corners (p, 3)."""
    corner = np.stack([mesh.r, mesh.s], axis=1)[mesh.triangles]
    base, first, second = corner[:, 0], corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    double = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    offset = points[:, None] - base
    one = (offset[..., 0] * second[:, 1] - offset[..., 1] * second[:, 0]) / double
    two = (first[:, 0] * offset[..., 1] - first[:, 1] * offset[..., 0]) / double
    shares = np.stack([1.0 - one - two, one, two], axis=2)
    best = np.argmax(shares.min(axis=2), axis=1)
    found = shares[np.arange(len(points)), best]
    found = np.clip(found, 0.0, None)  # a rod may run a hair outside the polygonal edge
    return best, found / found.sum(axis=1, keepdims=True)


def _film(layout: Plan) -> Membrane:
    film, mesh = layout.flexibility.film, layout.mesh
    slack = np.array([1.0 + film.slack_span, 1.0 + film.slack_chord])
    plane = np.stack([mesh.r, mesh.s], axis=1) * slack
    reference = np.concatenate([plane] * len(layout.panels))
    return Membrane(
        reference,
        layout.triangles,
        thickness=film.thickness,
        law=plane_stress(film.modulus, film.poisson),
        viscosity=layout.flexibility.damping.stiffness,
    )


def _inertia(layout: Plan, film: Membrane, paths: list[RodPath], total: int) -> Inertia:
    material = layout.flexibility.film
    mass = lumped_mass(film.areas, film.triangles, total, material.density * material.thickness)
    rotary = []
    for path in paths:
        share = path.mass[:, None] * path.weights
        mass += np.bincount(path.nodes.ravel(), share.ravel(), minlength=total)
        rotary.append(path.rotary)
    return Inertia(mass, np.concatenate(rotary))


def _root(layout: Plan, axes: FloatArray, bodies: list[int], triads: list[FloatArray]) -> HingedRoot:
    count = len(layout.mesh.r)
    nodes, group, place, swings = [], [], [], []
    for k in range(len(layout.panels)):
        for node, with_hinge in _held_nodes(layout):
            nodes.append(node + k * count)
            group.append(k)
            place.append(layout.flat[node])
            swings.append(with_hinge)
    held = Held(np.array(nodes), np.array(group), np.array(place), np.array(swings))
    first_bodies = np.concatenate([[0], np.cumsum(bodies)[:-1]]).astype(np.int64)
    number = np.arange(len(layout.panels), dtype=np.int64)
    rows = np.concatenate([layout.node_panel, np.repeat(number, bodies)])
    return HingedRoot(layout.hinges, held, first_bodies, number, np.array(triads), rows)


def _held_nodes(layout: Plan) -> list[tuple[int, bool]]:
    """Held nodes of a panel: the root of the spar, and the trailing-edge corner where it is held."""
    mesh, root = layout.mesh, layout.planform.root
    inner = np.flatnonzero(mesh.r == root)
    inner = inner[np.argsort(mesh.s[inner])]
    held = [(int(inner[0]), True)]
    choice = layout.flexibility.root.trailing_edge
    if choice != "free":
        held.append((int(inner[-1]), choice == "hinge"))
    return held
