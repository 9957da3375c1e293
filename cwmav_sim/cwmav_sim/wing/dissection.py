# SPDX-License-Identifier: Apache-2.0
"""An order of elimination that leaves little fill and short chains of work that waits for other work.

Nested dissection: a few vectors whose removal cuts a structure in two are eliminated last, the halves before
them in the same way, so that the halves never touch and can be worked on at the same time. Small pieces, and
every separator, are eliminated by minimum degree, separators still ahead counting as neighbours. The cut is
looked for where one of two far ends is as near as the other: such lines are straight and therefore short,
which levels of distance from one end are not.
Source: George, SIAM J. Numer. Anal. 10 (1973); Ashcraft & Liu, SIAM J. Matrix Anal. Appl. 19 (1998).
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from cwmav_sim.wing.algebra import compiled
from cwmav_sim.wing.sheet import IntArray

_SMALL = 40  # vectors that are not worth a cut: below that, the cuts themselves cost more fill than they save
_ENDS = 20  # vectors far from each other between which cuts are tried
_LEAST, _MOST = 0.3, 0.55  # share of the vectors that one half may have


def elimination_order(graph: sp.csc_matrix) -> IntArray:
    """Return the vectors in the order of their elimination, shape (n,).

    Vectors of one connected component follow each other.

    Parameters
    ----------
    graph : scipy.sparse.csc_matrix, shape (n, n)
        Symmetric pattern of the vectors that know each other; the values do not matter.
    """
    whole = graph.tocsr()
    return _by_degree(whole, _pieces(whole, np.arange(graph.shape[0], dtype=np.int64)))


def _pieces(graph: sp.csr_matrix, vectors: IntArray) -> list[IntArray]:
    """Return the pieces of a part of the whole with this graph, separators after what they separate."""
    count, component = connected_components(graph, directed=False)
    if count > 1:
        return [piece for number in range(count) for piece in _inside(graph, vectors, component == number)]
    if len(vectors) <= _SMALL:
        return [vectors]
    side = _cut(graph.indptr.astype(np.int64), graph.indices.astype(np.int64))
    if not side.any():
        return [vectors]
    halves = _inside(graph, vectors, side < 0) + _inside(graph, vectors, side > 0)
    return [*halves, vectors[side == 0]]


def _inside(graph: sp.csr_matrix, vectors: IntArray, chosen: NDArray[np.bool_]) -> list[IntArray]:
    kept = np.flatnonzero(chosen)
    return _pieces(graph[kept][:, kept], vectors[kept])


def _cut(starts: IntArray, beside: IntArray) -> IntArray:
    """Return the side of every vector, -1 or 1, and 0 for those that separate them; all 0 without a cut."""
    side, best = (np.zeros(len(starts) - 1, np.int64) for _ in range(2))
    _find_cut(starts, beside, _hops_from_ends(starts, beside), side, best)
    return best


@compiled
def _find_cut(starts: IntArray, beside: IntArray, hops: IntArray, side: IntArray, best: IntArray) -> None:
    """Find the best cut: the fewest vectors that separate, and of several such the most even sides."""
    count = len(side)
    least = count * count
    for first in range(len(hops)):
        for second in range(len(hops)):
            low, high = 0, 0
            for i in range(count):
                lead = hops[first, i] - hops[second, i]
                low, high = min(low, lead), max(high, lead)
            for limit in range(low, high):
                one, other, between = _divide(starts, beside, hops, first, second, limit, side)
                cost = count * between + abs(one - other)
                fair = _LEAST * count <= other <= _MOST * count and 0 < one <= _MOST * count
                if fair and cost < least:
                    least = cost
                    for i in range(count):
                        best[i] = side[i]


@compiled
def _divide(
    starts: IntArray, beside: IntArray, hops: IntArray, first: int, second: int, limit: int, side: IntArray
) -> tuple[int, int, int]:
    """Put vectors that lead by more than the limit on side 1; those of the others beside them separate.

    Returns how many lie on side -1, on side 1 and between.
    """
    one, other, between = 0, 0, 0
    for i in range(len(side)):
        if hops[first, i] - hops[second, i] > limit:
            side[i] = 1
            other += 1
            continue
        side[i] = -1
        for q in range(starts[i], starts[i + 1]):
            if hops[first, beside[q]] - hops[second, beside[q]] > limit:
                side[i] = 0
                break
        if side[i] < 0:
            one += 1
        else:
            between += 1
    return one, other, between


def _hops_from_ends(starts: IntArray, beside: IntArray) -> IntArray:
    """Return how many hops every vector is from each of some vectors far from each other, (ends, n)."""
    count = len(starts) - 1
    hops = np.empty((_ENDS, count), np.int64)
    _count_hops(starts, beside, 0, hops[0])
    end, nearest = int(np.argmax(hops[0])), np.full(count, count)
    for number in range(_ENDS):
        _count_hops(starts, beside, end, hops[number])
        nearest = np.minimum(nearest, hops[number])
        end = int(np.argmax(nearest))
    return hops


@compiled
def _count_hops(starts: IntArray, beside: IntArray, end: int, hops: IntArray) -> None:
    """Fill in the number of hops from one vector to every vector of a connected graph."""
    queue = np.empty(len(hops), np.int64)
    for i in range(len(hops)):
        hops[i] = -1
    queue[0], hops[end], known = end, 0, 1
    for at in range(len(hops)):
        i = queue[at]
        for q in range(starts[i], starts[i + 1]):
            j = beside[q]
            if hops[j] < 0:
                hops[j] = hops[i] + 1
                queue[known] = j
                known += 1


def _by_degree(graph: sp.csr_matrix, pieces: list[IntArray]) -> IntArray:
    """Return the vectors piece after piece, within each by the number of neighbours left (Tinney).

    Eliminating a vector joins its neighbours to each other.
    """
    near = [set(graph.indices[graph.indptr[i] : graph.indptr[i + 1]].tolist()) for i in range(graph.shape[0])]
    order = []
    for piece in pieces:
        left = set(piece.tolist())
        while left:
            at = min(left, key=lambda vector: (len(near[vector] - {vector}), vector))
            left.remove(at)
            order.append(at)
            for other in near[at] - {at}:
                near[other] |= near[at]
                near[other].remove(at)
    return np.array(order, dtype=np.int64)
