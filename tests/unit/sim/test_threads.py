# SPDX-License-Identifier: Apache-2.0
"""Results do not depend on the number of threads."""

import os
import subprocess
import sys

import pytest

STEPS = """
import hashlib
import numba
import numpy as np
from cwmav_sim import case as cases
from cwmav_sim.solver import Solver

case = cases.with_overrides(cases.preset("smoke"), ["wing.model=WING"])
solver = Solver(case.flow, case.motion(), case.airspeed, highest_speed=case.highest_speed())
for _ in range(4):
    solver.step()
state = [np.ascontiguousarray(v).tobytes() for v in (solver.position, solver.velocity, solver.density)]
print(numba.get_num_threads(), *(hashlib.sha256(v).hexdigest() for v in state))
"""


def run(threads, wing):
    answer = subprocess.run(
        [sys.executable, "-c", STEPS.replace("WING", wing)],
        env={**os.environ, "NUMBA_NUM_THREADS": str(threads)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert answer.returncode == 0, answer.stderr[-3000:]
    count, *state = answer.stdout.split()
    assert int(count) == threads
    return state


@pytest.mark.parametrize("wing", ["prescribed", "lattice"])
def test_one_thread_and_two_find_the_same_bits(wing):
    assert run(1, wing) == run(2, wing)
