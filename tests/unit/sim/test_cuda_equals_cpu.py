# SPDX-License-Identifier: Apache-2.0
"""The kernels for the graphics card against the processor, in numba's simulator of a card."""

import pytest

from support import cuda_cases
from support.cuda_process import assert_within, run, skip_without_card

ROUNDING = 1e-11  # pairs in double precision: the order of the sums is all that differs
EXACT = 0.0


def check(*arguments):
    return run("support.cuda_checks", *arguments)


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
    skip_without_card()
    assert_within(check(name), allowed)


@pytest.mark.cuda
@pytest.mark.parametrize("name", cuda_cases.cases())
def test_a_real_card_begins_a_verification_case_like_the_processor(name):
    skip_without_card()
    found = run("support.cuda_cases", name)
    del found["particles"]
    assert_within(found, 1e-8)


def test_comparing_a_verification_case_with_itself_finds_no_difference():
    found = run("support.cuda_cases", "taylor-green", "--host")
    assert found.pop("particles") > 1000
    assert_within(found, EXACT)


def test_every_kernel_compiles_for_a_card_as_far_as_that_goes_without_one():
    pytest.importorskip("numba_cuda")
    kernels = run("support.cuda_types")
    assert {"fluid_pass", "wall_pass", "reaction_pass", "predict", "correct", "_put_back"} <= set(kernels)
    assert kernels.count("fluid_pass") == 2  # with and without walls
