# SPDX-License-Identifier: Apache-2.0
"""Comparisons of the structure on the card with that on the processor, each run in a process of its own.

``python -m support.cuda_structure_checks NAME`` prints one JSON object: the largest difference of every
quantity over its largest value. Without a card to use, ``--simulate`` runs the kernels in numba's simulator.
"""

import json
import sys

if "--simulate" in sys.argv:
    import support.cuda_simulator  # noqa: F401 - before numba is imported

import numpy as np
import scipy.sparse as sp

from cwmav_sim.coupling import CoupledWings, Coupling
from cwmav_sim.cuda.block_lu import CardLU
from cwmav_sim.cuda.launch import Mail, empty, upload
from cwmav_sim.cuda.solver import CudaSolver
from cwmav_sim.cuda.structure import CardArithmetic
from cwmav_sim.kinematics import Kinematics
from cwmav_sim.solver import Solver
from cwmav_sim.sph.crossing import Crossings
from cwmav_sim.sph.settings import Box
from cwmav_sim.sph.sheet import SheetLoad
from cwmav_sim.wing.block_lu import BlockLU
from cwmav_sim.wing.contact import ContactLaw, Impacts
from cwmav_sim.wing.drive import StillRoot
from cwmav_sim.wing.dynamics import System
from cwmav_sim.wing.flexible import Flexibility, LatticeLayout, membrane_wings, plan
from cwmav_sim.wing.geometry import WingPlanform
from cwmav_sim.wing.integrate import Integration, Integrator
from cwmav_sim.wing.lattice import lattice_wings
from cwmav_sim.wing.parts import Inertia
from cwmav_sim.wing.prescribed import Attitude
from cwmav_sim.wing.sheet_map import NodesAreSheet
from support.cuda_checks import DP, difference, flow

SIMULATED = "--simulate" in sys.argv


def blocks(near, seed):
    """Return unsymmetric values in a symmetric pattern of 3 x 3 blocks."""
    rng = np.random.default_rng(seed)
    full = np.kron(near, np.ones((3, 3))) * rng.normal(size=(3 * len(near), 3 * len(near)))
    return sp.csc_matrix(full + 4.0 * np.sqrt(len(near)) * np.eye(3 * len(near)))


def scattered(seed, rows=40):
    """Return a random symmetric pattern; the last three rows hang on nothing."""
    rng = np.random.default_rng(seed)
    near = sp.random(rows, rows, density=0.06, random_state=rng).toarray() > 0
    near[-3:] = near[:, -3:] = False
    return near | near.T | np.eye(rows, dtype=bool)


def net(wide, high):
    """Return the pattern of a film: the corners of quadrilaterals, all of each beside each other."""
    line = [np.abs(np.subtract.outer(np.arange(n), np.arange(n))) <= 1 for n in (high, wide)]
    return np.kron(*line)


def apart(*patterns):
    """Return a pattern of several that do not know each other."""
    return sp.block_diag(patterns).toarray() > 0


def changed(a, seed):
    """Return other values in the same pattern."""
    values = a.data + 0.1 * np.random.default_rng(seed).normal(size=a.nnz)
    return sp.csc_matrix((values, a.indices, a.indptr), shape=a.shape)


def compare(*matrices):
    """Factorise matrices of one pattern, one after the other, and solve twice with each."""
    lu = BlockLU(matrices[0])
    card = CardLU(lu)
    rng = np.random.default_rng(7)
    worst = 0.0
    for a in matrices:
        factors = lu.factorised(a.data)
        card.factorise(upload(a.data))
        for _ in range(2):
            right = rng.normal(size=(len(lu.order), 3))
            out = empty(right.shape)
            card.solve(upload(right), out)
            worst = max(worst, difference(out.copy_to_host(), factors.solve(right)))
    return worst


def factors():
    """Compare solutions, also where rows know no other, and where they know all."""
    scenes = {f"scattered.{seed}": scattered(seed) for seed in range(2)} | {
        "films": apart(net(8, 5), net(6, 4)),
        "full": np.ones((10, 10), dtype=bool),
        "single": np.ones((1, 1), dtype=bool),
        "apart": np.eye(5, dtype=bool),
    }
    out = {}
    for seed, (name, near) in enumerate(scenes.items()):
        a = blocks(near, seed)
        out[name] = compare(a, changed(a, seed))
    return out


def structure():
    """Compare solutions with tangents of two wing panels, in the middle of a step and nearly static."""
    attitude = Attitude(frequency=12.0, angle_of_attack=0.3, airspeed=3.0)
    layout = plan(
        Flexibility(), WingPlanform(), Kinematics(), attitude, spacing=0.024, half=True, moving=True
    )
    moving = membrane_wings(layout)
    at = moving.save().configuration
    return {
        "solution": compare(
            moving.system.matrix(at, rate=2e4, mass_factor=4e8),
            moving.system.matrix(at, rate=2e2, mass_factor=4e4),
        )
    }


def failures():
    """Count singular matrices that are not refused, and sound ones that are, one after the other."""
    a = blocks(scattered(1), 1)
    card = CardLU(BlockLU(a))
    out = {}
    for name, value in (("sound", 1.0), ("zero", 0.0), ("again", 1.0), ("undefined", np.nan)):
        held = a.copy()
        held[-1, -3:] = value * held[-1, -3:]
        try:
            card.factorise(upload(held.data))
            refused = False
        except RuntimeError as error:
            refused = str(error) == "the matrix is singular"
        out[name] = float(refused == (value == 1.0))
    return out


def repeated():
    """Factorise and solve the same matrix twice: the same bits."""
    a = blocks(net(9, 5), 8)
    card = CardLU(BlockLU(a))
    right, bits = np.random.default_rng(9).normal(size=(45, 3)), set()
    for _ in range(2):
        out = empty(right.shape)
        card.factorise(upload(a.data))
        card.solve(upload(right), out)
        bits.add(out.copy_to_host().tobytes())
    return {"bits": float(len(bits) - 1)}


def wings(model, spacing=0.04):
    """Return small wings of two panels that the air moves."""
    attitude = Attitude(frequency=12.0, angle_of_attack=0.3, airspeed=3.0)
    flexibility = Flexibility(lattice=LatticeLayout(spanwise=3, chordwise=2))
    layout = plan(
        flexibility, WingPlanform(), Kinematics(), attitude, spacing=spacing, half=True, moving=True
    )
    build = {"membrane": membrane_wings, "lattice": lattice_wings}[model]
    return CoupledWings(build(layout), Coupling(substeps=2), 1.0 / 12.0)


def _exchange(model, steps):
    """Move wings on both devices under the same loads; at last each goes on from what the other saved."""
    host, card = wings(model), wings(model)
    there = CardArithmetic()
    card.bring(there)
    rng = np.random.default_rng(4)
    count = len(host.state(0.0).x)
    force, mass = 2e-4 / count * rng.normal(size=(count, 3)), 1e-4 / count * rng.uniform(size=count)
    for step in range(steps):
        if step == steps - 1:
            one, other = host.save(), card.save()
            card.restore(one)
            host.restore(other)
        card.settle()
        host.settle()
        t = host.structure.time + 4e-4
        strong = 3e4 if step == 0 else 1.0  # so strong that the step must be halved
        for moving, bring in ((host, np.copy), (card, there.brought)):
            load = SheetLoad(bring(strong * force), bring(mass))
            moving.foresee(t, load)
            moving.accept(t, load)
    return host, card


def _compare_wings(host, card):
    out = {}
    t = max(host.structure.time, card.structure.time)
    for name, found, expected in (
        ("reached", card.state(t), host.state(t)),
        ("ahead", card.state(t + 1e-4), host.state(t + 1e-4)),
    ):
        out |= {f"{name}.{q}": difference(getattr(found, q), getattr(expected, q)) for q in "xva"}
    saved, own = host.save(), card.save()
    out |= {name: difference(own[name], saved[name]) for name in saved if name != "energies"}
    energies = np.abs(own["energies"] - saved["energies"]).max() / np.abs(saved["energies"]).max()
    out["energies"] = float(energies)
    if SIMULATED:  # products that a card adds without rounding may cost or save an iteration
        out["counters"] = float(host.structure.counters != card.structure.counters)
    return out


def exchange_membrane():
    """Compare wings of film and rods after some steps."""
    host, card = _exchange("membrane", 2)
    return _compare_wings(host, card) | {"nothing": float(host.structure.counters.halvings == 0)}


def exchange_lattice():
    """Compare wings of facets after some steps."""
    return _compare_wings(*_exchange("lattice", 2))


def room():
    """Count arrays on the card that serve again while somebody holds them, or do not when nobody does."""
    there = CardArithmetic()
    first = there.brought(np.arange(6.0).reshape(2, 3))
    held = (first,)
    second = there.empty(2, 3)
    there.flat(second)
    wrong = int(second is first)
    number, other = id(second), id(first)
    del second
    wrong += int(id(there.empty(2, 3)) != number)
    del first
    wrong += int(id(there.empty(2, 3)) == other)
    wrong += int(not np.array_equal(there.on_host(held[0]), np.arange(6.0).reshape(2, 3)))
    mail, found = Mail(1024), []
    for size in (40, 60, 50, 90, 0, 30):  # goes round twice; 90 numbers are too many for it
        values = np.arange(float(size))
        target = empty(max(size, 1))
        mail.send(values, target)
        found.append(np.array_equal(target.copy_to_host()[:size], values))
    return {"wrong": float(wrong), "mail": float(found.count(False))}


def impact():
    """Compare what an impact of a light triangle on a heavy one does, found where its arrays lie."""
    lower = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    upper = np.array([[0.2, 0.2, 0.0], [0.6, 0.2, 0.5], [0.2, 0.6, 0.5]])
    triangles, panel, names = np.array([[0, 1, 2], [3, 4, 5]]), np.array([0, 1]), ("upper_x", "lower_x")
    none, no_bodies = np.zeros(0, dtype=np.int64), np.zeros((0, 3, 3))
    start, x = (np.concatenate([upper + np.array([0.0, 0.0, height]), lower]) for height in (1.0, 1e-4))
    v = np.concatenate([np.tile([0.3, 0.0, -2.0], (3, 1)), np.zeros((3, 3))])
    inertia = Inertia(np.repeat([1.0, 3.0], 3), np.zeros((0, 3)))
    system = System(inertia, [], StillRoot(x, no_bodies, none, none))
    motion = Integrator(system, Integration(), x, no_bodies, v=v).motion
    host, card = (
        Impacts(ContactLaw(), system, NodesAreSheet(system), triangles, panel, names, start) for _ in range(2)
    )
    there = CardArithmetic()
    card.bring(there, NodesAreSheet(system.brought(there)))
    expected, found = host.resolve(motion), card.resolve(motion.moved(there.brought)).moved(there.on_host)
    moved = np.abs(expected.configuration.v - v).max()
    return {
        "nothing": float(moved < 0.1 or card.largest == 0),
        "v": difference(found.configuration.v, expected.configuration.v),
        "lost": abs(found.energies.contact - expected.energies.contact),
    }


def _compare_hits(card):
    """Compare the loads of a step in which a particle hits a wall."""
    nodes = card._walls.nodes(card.time)
    kick = np.array([[1e-6, 2e-6, -3e-6]])
    hits = Crossings(np.array([1, 0]), np.zeros((2, 3)), np.array([0]), card.sheet.x[:1], kick)
    found, plain = card._walls._load(nodes, hits, 1e-4), card._walls._load(nodes, None, 1e-4)
    extra = found.force.copy_to_host() - plain.force.copy_to_host()
    return {"hit": difference(extra.sum(axis=0), kick[0] / 1e-4)}


def steps():
    """Compare a step of air around small flexible wings, all of it on the card or on the processor."""
    attitude = Attitude(frequency=12.0, angle_of_attack=0.3, airspeed=2.0)
    planform = WingPlanform(length=0.055, root=0.015, root_chord=0.03, straight_to=0.04)
    kinematics = Kinematics(clap_half_gap_deg=12.0)
    settings = flow(Box(length=9 * DP, width=10 * DP, height=9 * DP, upstream=4 * DP, symmetric=True))
    solvers = []
    for build in (Solver, CudaSolver):
        layout = plan(Flexibility(), planform, kinematics, attitude, spacing=DP, half=True, moving=True)
        moving = CoupledWings(membrane_wings(layout), Coupling(), 1.0 / 12.0)
        solvers.append((moving, build(settings, moving, 2.0)))
    (wings_host, host), (wings_card, card) = solvers
    expected, found = host.step(), card.step()
    out = {
        f"step.{name}": difference(getattr(found, name), getattr(expected, name))
        for name in ("dt", "pressure", "viscous", "power", "moment")
    }
    out |= {f"air.{q}": difference(getattr(card, q), getattr(host, q)) for q in ("position", "velocity")}
    out |= _compare_hits(card)
    out |= {f"sheet.{q}": difference(getattr(card.sheet, q), getattr(host.sheet, q)) for q in "xva"}
    return out | _compare_wings(wings_host, wings_card)


_ALL = (room, steps, factors, structure, failures, repeated, exchange_membrane, exchange_lattice, impact)
CHECKS = {check.__name__: check for check in _ALL}

if __name__ == "__main__":
    print(json.dumps(CHECKS[sys.argv[1]]()))
