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

from cwmav_sim.cuda.block_lu import CardLU
from cwmav_sim.cuda.launch import empty, upload
from cwmav_sim.kinematics import Kinematics
from cwmav_sim.wing.block_lu import BlockLU
from cwmav_sim.wing.flexible import Flexibility, membrane_wings, plan
from cwmav_sim.wing.geometry import WingPlanform
from cwmav_sim.wing.prescribed import Attitude


def difference(found, reference):
    return float(np.abs(found - reference).max() / max(np.abs(reference).max(), 1e-30))


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
        factors = lu.factorised(a)
        card.factorise(upload(a.data))
        for _ in range(2):
            right = rng.normal(size=(len(lu.order), 3))
            out = empty(right.shape)
            card.solve(upload(right), out)
            worst = max(worst, difference(out.copy_to_host(), factors.solve(right)))
    return worst


def factors():
    """Compare solutions, also where rows know no other, and where they know all."""
    scenes = {f"scattered.{seed}": scattered(seed) for seed in range(3)} | {
        "films": apart(net(12, 5), net(8, 4)),
        "full": np.ones((14, 14), dtype=bool),
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
    wings = membrane_wings(layout)
    at = wings.save().configuration
    return {
        "solution": compare(
            wings.system.matrix(at, rate=2e4, mass_factor=4e8),
            wings.system.matrix(at, rate=2e2, mass_factor=4e4),
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


CHECKS = {check.__name__: check for check in (factors, structure, failures, repeated)}

if __name__ == "__main__":
    print(json.dumps(CHECKS[sys.argv[1]]()))
