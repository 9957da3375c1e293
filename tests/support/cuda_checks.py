# SPDX-License-Identifier: Apache-2.0
"""Comparisons of the card with the processor, each run in a process of its own.

``python -m support.cuda_checks NAME`` prints one JSON object: the largest difference of every quantity over
its largest value. Without a card to use, ``--simulate`` runs the kernels in numba's simulator.
"""

import json
import math
import sys
from dataclasses import dataclass, field, replace

if "--simulate" in sys.argv:
    import support.cuda_simulator  # noqa: F401 - before numba is imported

import numpy as np
from numba import cuda

from cwmav_sim.cuda.cells import CardGrid, CellSort, find_cells
from cwmav_sim.cuda.crossing import Net
from cwmav_sim.cuda.launch import empty, launch, upload
from cwmav_sim.cuda.pair import add_pair, no_sums
from cwmav_sim.cuda.scan import Scan
from cwmav_sim.cuda.solver import CudaSolver
from cwmav_sim.solver import Solver
from cwmav_sim.sph.cells import make_grid, sort_into_cells
from cwmav_sim.sph.crossing import put_back
from cwmav_sim.sph.kernel import Kernel
from cwmav_sim.sph.pair import WORK_ROWS, pair_constants, sum_pairs
from cwmav_sim.sph.settings import Box, FlowSettings, Fluid, Fringe, Resolution, SheetOptions
from cwmav_sim.sph.state import Particles
from cwmav_sim.sph.surfaces import Sides
from cwmav_sim.verification.plates import FixedPlate, OscillatingPlate

DP = 0.0125
FLAT = Box(length=0.15, width=0.15, height=0.15, upstream=0.07, symmetric=False, dimensions=2)
HALF = Box(length=0.14, width=0.1, height=0.14, upstream=0.07, symmetric=True)
PLATE = OscillatingPlate(chord=0.05, span=0.05, spacing=DP, amplitude=0.01, frequency=8.0)


def flow(box, **changes):
    base = FlowSettings(
        fluid=Fluid(sound_speed=20.0),
        resolution=Resolution(dp=DP, cfl=0.4, precision="double", jitter=0.2),
        box=box,
        fringe=Fringe(width=0.04),
    )
    return replace(base, **changes)


def pair(settings, motion):
    """Return the solvers of both devices in the same lively state."""
    solvers = Solver(settings, motion, 2.0), CudaSolver(settings, motion, 2.0)
    state = solvers[0].save()
    rng = np.random.default_rng(3)
    state["v"] = state["v"] + rng.normal(0.0, 0.3, state["v"].shape)
    if settings.box.dimensions == 2:
        state["v"][:, 1] = 0.0
    state["rho"] = state["rho"] * (1.0 + 0.003 * rng.normal(size=len(state["rho"])))
    for solver in solvers:
        solver.restore({name: np.array(value) for name, value in state.items()})
    return solvers


def difference(found, reference):
    found, reference = np.asarray(found, float), np.asarray(reference, float)
    if reference.size == 0:
        return 0.0
    return float(np.abs(found - reference).max() / max(np.abs(reference).max(), 1e-30))


def rates(settings, motion):
    """Compare all that one pass finds, reactions and shifting included."""
    host, card = pair(settings, motion)
    walled = motion is not None
    expected = host._interaction.rates(host._air, host.sheet, shifting=True, reactions=walled)
    own = card._interaction.sides()
    card._interaction.rates(card._air, card.sheet, own, shifting=True, reactions=walled)
    passed = card._interaction
    out = {
        "acceleration": difference(passed.acceleration.copy_to_host().T, expected.acceleration),
        "density_rate": difference(passed.density_rate.copy_to_host(), expected.density_rate),
        "shift": difference(passed.shift.copy_to_host().T, expected.concentration_gradient),
    }
    if not walled:
        return out
    loads = empty(11 * passed.panels)
    passed.sum_loads(loads, 0)
    loads, sides = loads.copy_to_host().reshape(-1, 11), own.copy_to_host()
    reaction = passed.reaction.copy_to_host()
    return out | {
        "signed": difference(sides[:, 0], expected.sides.signed),
        "inside": difference(sides[:, 1], expected.sides.inside),
        "normal": difference(sides[:, 2:], expected.sides.normal),
        "pressure": difference(loads[:, :3], expected.pressure),
        "viscous": difference(loads[:, 3:6], expected.viscous),
        "power": difference(-(loads[:, 6] + loads[:, 7]), expected.power),
        "moment": difference(loads[:, 8:], expected.moment),
        "reaction": difference(reaction[:3], expected.reaction[:3]),
        "carried": difference(reaction[3], expected.reaction[3]),
    }


def open_flat():
    return rates(flow(FLAT), None)


def open_half():
    return rates(flow(HALF), None)


def walled_half():
    settings = flow(HALF, fluid=Fluid(sound_speed=20.0, gravity=9.81, background_pressure=5.0))
    return rates(settings, replace(PLATE, frequency=20.0))


def walled_mirror():
    """Compare all around a plate that goes on in its mirror image."""
    return rates(flow(HALF), FixedPlate(0.05, 0.1, DP / 2, math.radians(30.0), half=True))


def walled_flat():
    sheet = SheetOptions(approach_damping=10.0)
    return rates(
        flow(FLAT, fluid=Fluid(sound_speed=20.0, diffusion_near_wall="skip"), sheet=sheet), TwoPlates()
    )


@dataclass
class TwoPlates:
    """Two plates, one above the other, told the loads on them like wings that move by themselves."""

    loads: list = field(default_factory=list)
    panel_names: tuple = ("lower", "upper")

    @property
    def triangles(self):
        one = np.asarray(PLATE.triangles)
        return np.concatenate([one, one + len(PLATE.state(0.0).x)])

    @property
    def panel(self):
        return np.repeat([0, 1], len(PLATE.triangles))

    def state(self, t):
        return _Moved(PLATE.state(t), t)

    def foresee(self, t, load):
        self.loads.append(load)

    def accept(self, t, load):
        self.loads.append(load)


class _Moved:
    def __init__(self, nodes, t):
        apart = np.array([[0.01, 0.0, 1.3 * DP]])
        self.x = np.concatenate([nodes.x - apart, nodes.x + apart])
        self.v = np.concatenate([nodes.v, -nodes.v + [0.1, 0.0, 0.0]])
        self.a = np.concatenate([nodes.a, -nodes.a])


def _compare_steps(settings, motions, count):
    host = Solver(settings, motions[0], 2.0)
    card = CudaSolver(settings, motions[1], 2.0)
    out = {}
    for _ in range(count):
        expected, found = host.step(), card.step()
        for name in ("time", "dt", "pressure", "viscous", "power", "moment", "crossings"):
            key = f"step.{name}"
            out[key] = max(out.get(key, 0.0), difference(getattr(found, name), getattr(expected, name)))
    for name in ("position", "velocity", "density", "pressure", "identity", "wall_impulse"):
        out[name] = difference(getattr(card, name), getattr(host, name))
    for name in ("fringe_impulse", "gravity_impulse", "fringe_work"):
        out[name] = difference(getattr(card, name), getattr(host, name))
    out["kinetic_energy"] = difference(card.kinetic_energy(), host.kinetic_energy())
    out["momentum"] = difference(card.momentum(), host.momentum())
    out["pairs"] = difference(card.pairs(), host.pairs())
    return out


def steps_flat():
    """Several steps of air around two plates that take loads, with fringe, gravity and shifting."""
    settings = flow(
        FLAT,
        fluid=Fluid(sound_speed=20.0, gravity=9.81),
        fringe=Fringe(width=0.04, rate=200.0, around=True),
    )
    motions = TwoPlates(), TwoPlates()
    out = _compare_steps(settings, motions, 2)
    expected, found = motions[0].loads, motions[1].loads
    out["loads"] = difference(len(found), len(expected))
    out["load.force"] = difference([load.force for load in found], [load.force for load in expected])
    out["load.carried"] = difference([load.carried for load in found], [load.carried for load in expected])
    return out


def steps_crossing():
    """Let a particle slip through a plate: it is put back and the step begins anew."""
    host, card = pair(flow(FLAT), PLATE)
    host.step()
    state = {name: np.array(value) for name, value in host.save().items()}
    near = np.argmin(np.linalg.norm(state["x"], axis=1))
    gap = 0.08 * DP
    state["x"][near] = host.sheet.x.mean(axis=0) + np.array([0.0, 0.0, gap])
    state["sides.signed"][0, near], state["sides.inside"][0, near] = -gap, DP
    for solver in (host, card):
        solver.restore({name: np.array(value) for name, value in state.items()})
    expected, found = host.step(), card.step()
    return {
        "nothing": float(expected.crossings == 0),
        "crossings": difference(found.crossings, expected.crossings),
        "pressure": difference(found.pressure, expected.pressure),
        "position": difference(card.position, host.position),
        "velocity": difference(card.velocity, host.velocity),
        "wall_impulse": difference(card.wall_impulse, host.wall_impulse),
    }


def repeated():
    """Run the same steps twice, and once with a stop in between that goes through a saved state."""
    settings = flow(FLAT, resolution=Resolution(dp=DP, cfl=0.4, jitter=0.2))
    whole, again, resumed = (CudaSolver(settings, PLATE, 2.0) for _ in range(3))
    for _ in range(2):
        whole.step()
        again.step()
    again.step()
    resumed.restore(again.save())
    again.step()
    resumed.step()
    for _ in range(2):
        whole.step()
    out = {}
    for name in ("position", "velocity", "density", "identity", "wall_impulse"):
        bits = [np.ascontiguousarray(getattr(s, name)).tobytes() for s in (whole, again, resumed)]
        out[name] = float(len(set(bits)) - 1)
    return out


def sorting():
    """Compare the order of cells with the stable one, and running totals with NumPy's."""
    grid = make_grid(np.zeros(3), np.array([0.9, 0.7, 0.8]), 0.1, mirrored=False, dimensions=3)
    x = np.random.default_rng(1).uniform(0.0, 1.0, (150, 3)) ** 3 * grid.size
    expected = sort_into_cells(x, grid)
    sort = CellSort(len(x), grid.cells)
    find_cells(upload(x.T), CardGrid.of(grid, 0.1, np.dtype(np.float32)), sort.key)
    sort.sort()
    values = np.arange(200, dtype=np.int32) % 7
    totals = empty(201, np.int32)
    Scan(200)(upload(values), totals)
    return {
        "order": difference(sort.order.copy_to_host(), expected.order),
        "start": difference(sort.start.copy_to_host(), expected.start),
        "totals": difference(totals.copy_to_host(), np.concatenate([[0], np.cumsum(values)])),
    }


def crossing():
    """Put particles back that changed sides, some of them of both walls."""
    rng = np.random.default_rng(5)
    n, panels, dt = 40, 2, 1e-3
    x, v = rng.normal(size=(n, 3)), rng.normal(size=(n, 3))
    normal = rng.normal(size=(panels, 3, n)).astype(np.float32)
    before, now = (
        Sides(
            rng.uniform(-0.1, 0.1, (panels, n)).astype(np.float32) * DP,
            rng.uniform(-0.3, 1.0, (panels, n)).astype(np.float32),
            normal,
        )
        for _ in range(2)
    )
    particles = Particles(x.copy(), v.copy(), np.ones(n), 1e-6, np.arange(n))
    expected = put_back(particles, before, now, panels, DP, dt)
    on_card = [
        upload(np.concatenate([np.stack([s.signed, s.inside], axis=1), s.normal], axis=1))
        for s in (before, now)
    ]
    card_x, card_v = upload(x.T), upload(v.T)
    net = Net(n, panels, DP)
    net.put_back(card_x, card_v, *on_card, 1e-6, dt)
    found = net.caught(card_x, dt)
    return {
        "events": float(expected.count.sum() < 4),
        "x": difference(card_x.copy_to_host().T, particles.x),
        "v": difference(card_v.copy_to_host().T, particles.v),
        "count": difference(found.count, expected.count),
        "impulse": difference(found.impulse, expected.impulse),
        "panel": difference(found.panel, expected.panel),
        "event.x": difference(found.x, expected.x),
        "event.kick": difference(found.kick, expected.kick),
    }


@cuda.jit
def _each_pair(rows, own, k, out):
    j = cuda.grid(1)
    if j < rows.shape[1]:
        dx, dy, dz = own[0] - rows[0, j], own[1] - rows[1, j], own[2] - rows[2, j]
        apart = (dx, dy, dz, dx * dx + dy * dy + dz * dz)
        b = (rows[3, j], rows[4, j], rows[5, j], rows[6, j], rows[7, j], rows[8, j])
        sums = add_pair(no_sums(k), apart, (own[3], own[4], own[5], own[6], own[7]), b, k, True)
        for q in range(11):
            out[q, j] = sums[q]


def formula():
    """Compare the formula for one pair with that of the CPU over random pairs."""
    kernel = Kernel(1.7 * DP, 3)
    k = pair_constants(kernel.h, 1.2, float(kernel.value(DP)), kernel.amplitude, 0.2, np.dtype(np.float64))
    rng = np.random.default_rng(2)
    n = 60
    rows = np.concatenate(
        [
            rng.uniform(-2.0, 2.0, (3, n)) * kernel.h,
            rng.normal(size=(3, n)),
            0.01 * rng.normal(size=(1, n)),
            5.0 * rng.normal(size=(1, n)),
            rng.uniform(0.5, 1.5, (1, n)) * DP**3,
        ]
    )
    a = (0.0, 0.0, 0.0, 0.3, -0.2, 0.1, 0.004, 2.0)

    out = empty((11, n))
    launch(_each_pair, n, upload(rows), a, tuple(k), out)
    found = out.copy_to_host()
    diffusion, viscosity = 0.3, 0.7
    singles = (np.ascontiguousarray(rows[:, j : j + 1]) for j in range(n))
    work = np.empty((WORK_ROWS, 1))
    own = (diffusion, viscosity)
    expected = np.array([sum_pairs(a, own, row, row[8], 1, k, True, work) for row in singles]).T
    summed = np.vstack([found[0] - diffusion * found[1], found[2:5] - viscosity * found[5:8], found[8:]])
    names = ["continuity", *(f"{q}{w}" for q in ("momentum", "shifting") for w in "xyz")]
    return {name: difference(summed[q], expected[q]) for q, name in enumerate(names)} | {
        "inside": float(np.count_nonzero(expected[0]) < 10)
    }


CHECKS = {
    check.__name__: check
    for check in (
        formula,
        sorting,
        crossing,
        open_flat,
        open_half,
        walled_flat,
        walled_half,
        walled_mirror,
        steps_flat,
        steps_crossing,
        repeated,
    )
}

if __name__ == "__main__":
    print(json.dumps(CHECKS[sys.argv[1]]()))
