# SPDX-License-Identifier: Apache-2.0
"""Who works on what at the same time where some results need others: level after level.

The level of a target is the one after the last of what it needs, so targets of one level do not know each
other. Near the end of an elimination few targets are left that subtract many products each, most of which
were known long before. Several of these are therefore subtracted as soon as they are known, while threads
would be idle, yet always in their order. Targets that do not hang together are pieces with levels of their
own.
Source: Anderson & Saad, Int. J. High Speed Comput. 1 (1989).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cwmav_sim.wing.algebra import compiled
from cwmav_sim.wing.sheet import IntArray

_SEVERAL = 8  # products known early that are worth reading and writing a target once more


@dataclass(frozen=True)
class Work:
    """What has to be done to blocks, or to rows: the targets.

    Attributes
    ----------
    turns : ndarray, shape (m,)
        The targets, each after all that it needs.
    piece : ndarray, shape (m,)
        Piece that every target belongs to.
    first, last : ndarray, shape (m,)
        The products subtracted from a target are those from its first to before its last.
    needs : ndarray, shape (2, products)
        The targets that must be done before a product is known.
    divisor : ndarray, shape (m,)
        The target by which another is divided after its last product; -1: it is finished in another way.
    """

    turns: IntArray
    piece: IntArray
    first: IntArray
    last: IntArray
    needs: IntArray
    divisor: IntArray


def plan(work: Work) -> tuple[tuple[IntArray, ...], IntArray]:
    """Plan the work level after level, piece after piece.

    Returns
    -------
    arrays : tuple of ndarray
        ``first_level``, shape (pieces + 1,): first level of every piece. ``first_sum`` and ``first_done``,
        shape (levels + 1,): first sum of every level and first of the targets finished after these sums.
        ``target``, ``begin`` and ``end``, shape (sums,): target of every sum and its range of products.
        ``done``: the targets to be finished.
    divisor : ndarray, shape (sums,)
        The target that divides that of a sum after its last product; -1: none does.
    """
    level = _levels(work.turns, work.first, work.last, work.needs, work.divisor)
    known = 1 + level[work.needs].max(axis=0)
    target, begin, end, when = _sums(level, work.first, work.last, known)
    divisor = np.where(when == level[target], work.divisor[target], -1)
    depth = np.zeros(work.piece.max() + 1, dtype=np.int64)
    np.maximum.at(depth, work.piece, level + 1)
    first_level = np.concatenate([[0], np.cumsum(depth)])
    start = first_level[work.piece]
    needed = np.flatnonzero((begin < end) | (divisor >= 0))
    sums, first_sum = _by_level(start[target] + when, needed, first_level[-1])
    done, first_done = _by_level(start + level, np.flatnonzero(work.divisor < 0), first_level[-1])
    arrays = (first_level, first_sum, first_done, target[sums], begin[sums], end[sums], done)
    return arrays, divisor[sums]


def _by_level(level: IntArray, items: IntArray, levels: int) -> tuple[IntArray, IntArray]:
    """Return items sorted by their level, and the first of every level, shape (levels + 1,)."""
    ordered = items[np.argsort(level[items], kind="stable")]
    return ordered, np.searchsorted(level[ordered], np.arange(levels + 1))


@compiled
def _levels(turns: IntArray, first: IntArray, last: IntArray, needs: IntArray, divisor: IntArray) -> IntArray:
    """Return the level of every target: the one after the last of what it needs."""
    level = np.zeros(len(turns), np.int64)
    for target in turns:
        found = level[divisor[target]] if divisor[target] >= 0 else -1
        for q in range(first[target], last[target]):
            found = max(found, level[needs[0, q]], level[needs[1, q]])
        level[target] = found + 1
    return level


@compiled
def _sums(level: IntArray, first: IntArray, last: IntArray, known: IntArray) -> IntArray:
    """Return target, range of products and level of every sum, shape (4, sums).

    A sum ends before the first product not yet known, whatever is known behind it: the order stays.
    """
    out = np.empty((4, len(level) + len(known) // _SEVERAL), np.int64)
    made = 0
    for target in range(len(level)):
        begin, when = first[target], 0
        for q in range(first[target], last[target]):
            when = max(when, known[q])
            if when == level[target]:
                break
            more = q + 1 < last[target] and known[q + 1] <= when
            if not more and q + 1 - begin >= _SEVERAL:
                out[0, made], out[1, made], out[2, made], out[3, made] = target, begin, q + 1, when
                begin, made = q + 1, made + 1
        out[0, made], out[1, made], out[2, made], out[3, made] = target, begin, last[target], level[target]
        made += 1
    return out[:, :made]
