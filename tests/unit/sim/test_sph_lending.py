# SPDX-License-Identifier: Apache-2.0
"""Arrays that are lent keep their values until they are given back, and are given back."""

from typing import NamedTuple

import numba as nb
import numpy as np
from numba.core.runtime import _nrt_python, rtsys

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
    sum_of_lent(10)
    counted = _nrt_python.memsys_stats_enabled()
    _nrt_python.memsys_enable_stats()
    try:
        before = rtsys.get_allocation_stats()
        for _ in range(50):
            sum_of_lent(10)
        after = rtsys.get_allocation_stats()
    finally:
        if not counted:
            _nrt_python.memsys_disable_stats()
    assert after.alloc - before.alloc >= 50 * 4
    assert after.alloc - before.alloc == after.free - before.free
