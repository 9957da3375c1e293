# SPDX-License-Identifier: Apache-2.0
"""Arrays that are lent keep their values until they are given back, and are given back."""

import resource
from typing import NamedTuple

import numba as nb
import numpy as np

from cwmav_sim.sph.lending import held, lent


class Pair(NamedTuple):
    first: np.ndarray
    second: np.ndarray


@nb.njit
def sum_of_lent(n):
    own = Pair(np.arange(n), np.ones((n, 2))), np.full(n, 2.0)
    (first, second), third = lent(own)
    spoil = np.full(4 * n, -1.0)  # takes the memory of whatever was given back too early
    total = 0.0
    for i in range(n):
        row = second[i]
        total += first[i] + row[0] + row[1] + third[i]
    held(own)
    return total, spoil.sum()


def test_lent_tuples_keep_their_values():
    n = 1000
    assert sum_of_lent(n) == (n * (n - 1) / 2 + 4.0 * n, -4.0 * n)


def test_what_was_lent_is_given_back():
    n, runs = 300_000, 60  # 19 MB each
    sum_of_lent(n)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(runs):
        sum_of_lent(n)
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before  # kB
    assert grown < 0.2 * runs * 64 * n / 1024
