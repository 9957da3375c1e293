# SPDX-License-Identifier: Apache-2.0
"""The kernels for the graphics card against the processor, in numba's simulator of a card."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from cwmav_sim.cuda.device import find_card
from support import cuda_cases

ROUNDING = 1e-11  # pairs in double precision: the order of the sums is all that differs
EXACT = 0.0
TESTS = Path(__file__).parents[2]


def run(module, *arguments):
    path = os.pathsep.join([str(TESTS), *(p for p in sys.path if p)])
    answer = subprocess.run(
        [sys.executable, "-m", module, *arguments],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert answer.returncode == 0, answer.stderr[-3000:]
    return answer


def check(*arguments):
    return json.loads(run("support.cuda_checks", *arguments).stdout)


def assert_within(differences, allowed):
    beyond = {name: value for name, value in differences.items() if not value <= allowed}
    assert not beyond


CASES = [
    ("formula", ROUNDING),
    ("sorting", EXACT),
    ("crossing", 1e-6),  # sides are kept in single precision,
    ("open_flat", ROUNDING),
    ("open_half", ROUNDING),
    ("walled_flat", ROUNDING),
    ("walled_half", ROUNDING),
    ("walled_mirror", ROUNDING),
    ("steps_flat", 1e-9),
    ("steps_crossing", 1e-9),
    ("repeated", EXACT),
]


@pytest.mark.parametrize(("name", "allowed"), CASES)
def test_the_card_finds_what_the_processor_finds(name, allowed):
    assert_within(check(name, "--simulate"), allowed)


@pytest.mark.cuda
@pytest.mark.parametrize(("name", "allowed"), CASES)
def test_a_real_card_finds_what_the_processor_finds(name, allowed):
    if not find_card().usable:
        pytest.skip(find_card().missing)
    assert_within(check(name), allowed)


@pytest.mark.cuda
@pytest.mark.parametrize("name", cuda_cases.cases())
def test_a_real_card_begins_a_verification_case_like_the_processor(name):
    if not find_card().usable:
        pytest.skip(find_card().missing)
    found = json.loads(run("support.cuda_cases", name).stdout)
    del found["particles"]
    assert_within(found, 1e-8)


def test_comparing_a_verification_case_with_itself_finds_no_difference():
    found = json.loads(run("support.cuda_cases", "taylor-green", "--host").stdout)
    assert found.pop("particles") > 1000
    assert_within(found, EXACT)


def test_every_kernel_compiles_for_a_card_as_far_as_that_goes_without_one():
    pytest.importorskip("numba_cuda")
    kernels = json.loads(run("support.cuda_types").stdout)
    assert {"fluid_pass", "wall_pass", "reaction_pass", "predict", "correct", "_put_back"} <= set(kernels)
    assert kernels.count("fluid_pass") == 2  # with and without walls
