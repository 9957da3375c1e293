# SPDX-License-Identifier: Apache-2.0
"""The factors of the structure on the card against the processor's, in numba's simulator of a card."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cwmav_sim.cuda.device import find_card
from cwmav_sim.cuda.levels import Work, plan

ROUNDING = 1e-11
EXACT = 0.0
TESTS = Path(__file__).parents[2]
CASES = [
    ("factors", ROUNDING),
    (
        "structure",
        1e-8,
    ),  # what rounding in one tangent leaves of the solution for a film that is easy to bend
    ("failures", EXACT),
    ("repeated", EXACT),
]


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
    return json.loads(answer.stdout)


def assert_within(differences, allowed):
    beyond = {name: value for name, value in differences.items() if not value <= allowed}
    assert not beyond


@pytest.mark.parametrize(("name", "allowed"), CASES)
def test_the_card_finds_what_the_processor_finds(name, allowed):
    assert_within(run("support.cuda_structure_checks", name, "--simulate"), allowed)


@pytest.mark.cuda
@pytest.mark.parametrize(("name", "allowed"), CASES)
def test_a_real_card_finds_what_the_processor_finds(name, allowed):
    if not find_card().usable:
        pytest.skip(find_card().missing)
    assert_within(run("support.cuda_structure_checks", name), allowed)


def test_every_kernel_compiles_for_a_card_as_far_as_that_goes_without_one():
    pytest.importorskip("numba_cuda")
    kernels = run("support.cuda_types", "structure")
    assert kernels == ["_factorise", "_fill", "_solve_down", "_solve_up"]


def walked(work):
    """Do the work as planned; return the products subtracted from every target, and the longest sum.

    What a sum needs must have been finished in a level before.
    """
    arrays, divisor = plan(work)
    first_level, first_sum, first_done, target, begin, end, done = arrays
    products = {number: list(range(work.first[number], work.last[number])) for number in work.turns}
    finished, longest = set(), 0
    for piece in range(len(first_level) - 1):
        for level in range(first_level[piece], first_level[piece + 1]):
            ended = set(done[first_done[level] : first_done[level + 1]].tolist())
            for s in range(first_sum[level], first_sum[level + 1]):
                taken = list(range(begin[s], end[s]))
                assert work.piece[target[s]] == piece
                assert products[target[s]][: len(taken)] == taken
                assert finished.issuperset(work.needs[:, taken].ravel().tolist())
                del products[target[s]][: len(taken)]
                longest = max(longest, len(taken))
                if divisor[s] >= 0:
                    assert divisor[s] in finished
                    ended.add(int(target[s]))
            assert not any(products[number] for number in ended)
            assert not ended & finished
            finished |= ended
    assert finished == set(work.turns.tolist())
    return longest


def test_all_work_is_planned_once_and_after_what_it_needs():
    rng = np.random.default_rng(2)
    count = 60
    numbers = np.arange(count)
    many = np.minimum(numbers, 40)
    last = np.cumsum(many)
    needs = [np.sort(rng.integers(0, number, (2, many[number])), axis=1) for number in numbers]
    divisor = np.where(numbers % 3 == 0, -1, numbers - 1)
    walked(Work(numbers, np.zeros(count, int), last - many, last, np.hstack(needs), divisor))


def test_what_is_known_early_is_not_left_to_the_end():
    """Sixty targets in a row; the last one needs them all."""
    numbers = np.arange(61)
    last = np.concatenate([[0], np.arange(1, 60), [59 + 60]])
    first = np.concatenate([[0], np.arange(59), [59]])
    needs = np.tile(np.concatenate([np.arange(59), np.arange(60)]), (2, 1))
    work = Work(numbers, np.zeros(61, int), first, last, needs, np.full(61, -1))
    assert walked(work) <= 8


def test_pieces_have_levels_of_their_own():
    """Three targets in a row, two, and one that knows nobody."""
    work = Work(
        turns=np.arange(6),
        piece=np.array([0, 0, 0, 1, 1, 2]),
        first=np.array([0, 0, 1, 2, 2, 3]),
        last=np.array([0, 1, 2, 2, 3, 3]),
        needs=np.tile([0, 1, 3], (2, 1)),
        divisor=np.full(6, -1),
    )
    assert plan(work)[0][0].tolist() == [0, 3, 5, 6]
    walked(work)
