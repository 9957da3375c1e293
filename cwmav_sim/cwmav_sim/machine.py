# SPDX-License-Identifier: Apache-2.0
"""What the machine itself can do: arithmetic and memory, measured the way the solver uses them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

_LANES = 512  # independent sums: enough to hide the latency of a fused multiply-add on any processor
_ROUNDS = 2000
_TRIAD = 8_000_000  # floats; three such arrays are larger than the caches


@dataclass(frozen=True)
class MachineLimits:
    """Highest rates seen on all threads together.

    Attributes
    ----------
    gflops : float
        Single-precision multiplications and additions per second, fused, data in registers and first
        cache [1e9/s].
    bandwidth : float
        Bytes moved per second by ``a = b + s c`` on arrays larger than the caches [GB/s] (J. D. McCalpin's
        STREAM triad).
    """

    gflops: float
    bandwidth: float


def measure_limits(repeats: int = 5) -> MachineLimits:
    """Measure both limits; takes about a second."""
    threads = nb.get_num_threads()
    sums = np.ones((threads, _LANES), np.float32)
    a, b, c = (np.ones(_TRIAD, np.float32) for _ in range(3))
    factor = np.float32(0.999)
    arithmetic = _shortest(lambda: _multiply_add(sums, factor, _ROUNDS), repeats)
    memory = _shortest(lambda: _triad(a, b, c, factor), repeats)
    return MachineLimits(
        gflops=2e-9 * threads * _LANES * _ROUNDS / arithmetic, bandwidth=1e-9 * 3 * a.nbytes / memory
    )


def _shortest(work: Callable[[], None], repeats: int) -> float:
    work()  # compiles
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return min(times)


@nb.njit(cache=True, parallel=True, fastmath=True, error_model="numpy")
def _multiply_add(sums: NDArray, factor: np.float32, rounds: int) -> None:
    for thread in nb.prange(sums.shape[0]):
        own = sums[thread]
        for _ in range(rounds):
            for lane in range(_LANES):
                own[lane] = own[lane] * factor + factor


@nb.njit(cache=True, parallel=True, fastmath=True, error_model="numpy")
def _triad(a: NDArray, b: NDArray, c: NDArray, factor: np.float32) -> None:
    for i in nb.prange(a.shape[0]):
        a[i] = b[i] + factor * c[i]
