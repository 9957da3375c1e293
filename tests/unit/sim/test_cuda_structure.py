# SPDX-License-Identifier: Apache-2.0
"""The structure of the wings on the card against the processor's, in numba's simulator of a card."""

import inspect
from importlib import import_module

import pytest

from support.cuda_process import assert_within, run, skip_without_card

EXACT = 0.0
SUMS = 1e-14  # the same bits but for the order of the sums of energies
STEPS = 1e-9  # the air's sums have another order
# On a card products are added without rounding. Solutions for a film that is easy to bend feel that in their
# eighth digit.
CASES = [
    ("room", EXACT, EXACT),
    ("factors", EXACT, 1e-11),
    ("structure", EXACT, 1e-8),
    ("failures", EXACT, EXACT),
    ("exchange_membrane", SUMS, 1e-6),
    ("exchange_lattice", SUMS, 1e-6),
    ("impact", EXACT, 1e-11),
    ("steps", STEPS, 1e-6),
]


@pytest.mark.parametrize(("name", "allowed"), [(name, allowed) for name, allowed, _ in CASES])
def test_the_card_finds_what_the_processor_finds(name, allowed):
    assert_within(run("support.cuda_structure_checks", name, "--simulate"), allowed)


@pytest.mark.cuda
@pytest.mark.parametrize(
    ("name", "allowed"), [*((name, allowed) for name, _, allowed in CASES), ("repeated", EXACT)]
)
def test_a_real_card_finds_what_the_processor_finds(name, allowed):
    skip_without_card()
    assert_within(run("support.cuda_structure_checks", name), allowed)


def test_every_kernel_compiles_for_a_card_as_far_as_that_goes_without_one():
    pytest.importorskip("numba_cuda")
    kernels = set(run("support.cuda_types", "structure"))
    assert {"_factorise", "_fill", "_solve_down", "_solve_up", "_largest", "_reduce_blocks"} <= kernels
    on_host_alone = {"film_strain", "given_rates", "squares"}
    assert loops() - on_host_alone <= kernels


def loops():
    """Return the names of all loops of the structure."""
    found = set()
    for name in ("connector", "contact", "coupling", "facet", "film", "load", "motion", "step"):
        for member in vars(import_module(f"cwmav_sim.wing.{name}_loops")).values():
            function = getattr(member, "py_func", None)
            if function and list(inspect.signature(function).parameters)[:2] == ["first", "last"]:
                found.add(function.__name__)
    return found
