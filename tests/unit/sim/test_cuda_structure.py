# SPDX-License-Identifier: Apache-2.0
"""The structure of the wings on the card against the processor's, in numba's simulator of a card."""

import pytest

from support.cuda_process import assert_within, run, skip_without_card

EXACT = 0.0
ROUNDING = 1e-11
BENT = 1e-8  # what rounding in one tangent leaves of the solution for a film that is easy to bend
CASES = [
    ("factors", ROUNDING),
    ("structure", BENT),
    ("failures", EXACT),
    ("repeated", EXACT),
    ("exchange_membrane", 1e-7),
    ("exchange_lattice", 1e-7),
    ("impact", ROUNDING),
    ("steps", 1e-7),
]


@pytest.mark.parametrize(("name", "allowed"), CASES)
def test_the_card_finds_what_the_processor_finds(name, allowed):
    assert_within(run("support.cuda_structure_checks", name, "--simulate"), allowed)


@pytest.mark.cuda
@pytest.mark.parametrize(("name", "allowed"), CASES)
def test_a_real_card_finds_what_the_processor_finds(name, allowed):
    skip_without_card()
    assert_within(run("support.cuda_structure_checks", name), allowed)


def test_every_kernel_compiles_for_a_card_as_far_as_that_goes_without_one():
    pytest.importorskip("numba_cuda")
    kernels = set(run("support.cuda_types", "structure"))
    assert {"_factorise", "_solve_down", "_solve_up", "connector_tangent", "film_tangent"} <= kernels
    assert {"carried_motion", "touched", "nearest_squares", "predicted", "node_normals"} <= kernels
