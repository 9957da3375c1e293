# SPDX-License-Identifier: Apache-2.0
"""What the card works on at the same time when it factorises: all of it once, and after what it needs."""

import numpy as np
import scipy.sparse as sp

from cwmav_sim.cuda import block_lu
from cwmav_sim.cuda.levels import Work, plan
from cwmav_sim.wing.block_lu import BlockLU


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
            summed = target[first_sum[level] : first_sum[level + 1]].tolist()
            assert len(set(summed)) == len(summed)  # two threads must not add to one target
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


def test_the_factors_of_films_are_planned_like_that(monkeypatch):
    line = np.abs(np.subtract.outer(np.arange(7), np.arange(7))) <= 1
    films = sp.block_diag([np.kron(line, line), np.kron(line[:4, :4], line)])
    lu = BlockLU(sp.csc_matrix(sp.kron(films, np.ones((3, 3)))))
    piece = np.repeat([0, 1], [49, 28])[lu.order]
    seen = []
    monkeypatch.setattr(block_lu, "plan", lambda work: seen.append(work) or plan(work))
    block_lu._plan_blocks(lu, piece)
    block_lu._plan_rows(lu, piece)
    assert len(seen) == 3
    for work in seen:
        walked(work)
