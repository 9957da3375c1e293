# SPDX-License-Identifier: Apache-2.0
"""One thread for small linear algebra.

The matrices of a Kriging are small. Threads of the linear algebra library gain nothing on them, and where
other processes use the cores they cost: waiting threads spin, and a fit was measured 50 times slower. So
fits and predictions run on one thread each; long predictions are shared among threads of our own, block by
block.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import TypeVar

from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]

T = TypeVar("T")


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()


@contextmanager
def single_thread() -> Iterator[None]:
    """Limit the linear algebra libraries of this process to one thread, and set back what was."""
    with _controller().limit(limits=1, user_api="blas"):
        yield


def for_each_block(work: Callable[[T], None], blocks: Sequence[T]) -> None:
    """Run `work` on every block, in parallel where there are many; each must write to a place of its own."""
    # The number of processors is asked for only where it matters: a swarm predicts thousands of times.
    workers = 1 if len(blocks) < 4 else min(os.cpu_count() or 1, len(blocks) // 2)
    with single_thread():
        if workers < 2:
            for block in blocks:
                work(block)
            return
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(work, blocks))  # drawn, so that an error in a block is raised here
