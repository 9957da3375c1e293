# SPDX-License-Identifier: Apache-2.0
"""The first steps of a verification case on the card and on the processor.

``python -m support.cuda_cases NAME`` prints one JSON object: the largest difference of every quantity over
its scale. The case runs as it stands but for the precision of the pairs, which is double, so that nothing but
the order of sums tells the two apart. ``--host`` compares the processor with
itself, which shows that nothing of a case is shared by the two solvers.
"""

import json
import sys
from copy import deepcopy
from dataclasses import replace
from functools import partial

import numpy as np

from cwmav_sim.devices import make_solver
from cwmav_sim.solver import Solver
from cwmav_sim.verification.catalogue import catalogue

STEPS = 6
COMPOSED = ("convergence",)  # of other cases


class ComparedError(Exception):
    """Ends a case with what was found."""


def cases():
    """Return the cases that move air."""
    return [c.name for c in catalogue() if not c.name.startswith("structure-") and c.name not in COMPOSED]


def compare(name, other):
    """Return the differences after some steps of a case on the processor and on the ``other`` device."""
    case = next(c for c in catalogue() if c.name == name)
    module = sys.modules[type(case).__module__]

    def build(settings, motion, airspeed, **options):
        settings = replace(settings, resolution=replace(settings.resolution, precision="double"))
        own = deepcopy(motion)
        host = Solver(settings, motion, airspeed, **options)
        card = other(settings, own, airspeed, **options)
        raise ComparedError(_differences(host, card, settings))

    module.Solver = build
    try:
        case.run()
    except ComparedError as found:
        return found.args[0]
    finally:
        module.Solver = Solver
    raise AssertionError(f"{name} made no solver")


def _differences(host, card, settings):
    dp, c0, rho0 = settings.resolution.dp, host.sound_speed, settings.fluid.density
    force = 1e-6 * rho0 * c0**2 * dp ** (settings.box.dimensions - 1)
    worst = {}

    def note(quantity, found, expected, least):
        found, expected = np.asarray(found, float), np.asarray(expected, float)
        if expected.size:
            scale = max(float(np.abs(expected).max()), least)
            error = float(np.abs(found - expected).max()) / scale
            worst[quantity] = max(worst.get(quantity, 0.0), error)

    for _ in range(STEPS):
        expected, found = host.step(), card.step()
        note("dt", found.dt, expected.dt, 0.0)
        note("pressure force", found.pressure, expected.pressure, force)
        note("viscous force", found.viscous, expected.viscous, force)
        note("moment", found.moment, expected.moment, force * dp)
        note("power", found.power, expected.power, force * c0)
        note("crossings", found.crossings, expected.crossings, 1.0)
    note("position", card.position, host.position, 0.0)
    note("velocity", card.velocity, host.velocity, 1e-6 * c0)
    note("density", card.density - rho0, host.density - rho0, 1e-9 * rho0)
    note("order", card.identity, host.identity, 0.0)
    return worst | {"particles": host.particles}


if __name__ == "__main__":
    device = "cpu" if "--host" in sys.argv else "cuda"
    print(json.dumps(compare(sys.argv[1], partial(make_solver, device))))
