# SPDX-License-Identifier: Apache-2.0
"""Starting kernels and keeping arrays on the card."""

from __future__ import annotations

import warnings
from functools import cache
from typing import Any

import numpy as np
from numba import config, cuda
from numpy.typing import DTypeLike, NDArray

from cwmav_sim.cuda.starting import Starter, pack_array

# Threads of a block; sums over blocks, and so the last bits of results, depend on it. The simulator starts a
# thread of the operating system for each.
THREADS = 16 if config.ENABLE_CUDASIM else 128

# Threads of a block that works alone on what hangs together.
MANY_THREADS = 16 if config.ENABLE_CUDASIM else 512

# Threads that share the work of one particle where it is large: a warp.
LANES = 4 if config.ENABLE_CUDASIM else 32

# Running totals end in a single block, and small cases never fill a card.
warnings.filterwarnings("ignore", message=".*Grid size .* under-utilization")

_ALIGNED = 64  # bytes

CardArray = Any  # an array in the memory of the card


def blocks(count: int) -> int:
    """Return the number of blocks that give each of ``count`` items a thread."""
    return max(1, -(-count // THREADS))


def launch(kernel: Any, count: int, *args: Any) -> None:
    """Run a kernel with a thread for each of ``count`` items; the card works on while the caller goes on."""
    start_blocks(kernel, blocks(count), *args)


def start_blocks(kernel: Any, count: int, *args: Any, threads: int = THREADS) -> None:
    """Run a kernel with so many blocks of threads."""
    if config.ENABLE_CUDASIM:
        kernel[count, threads](*(_plain(v) if isinstance(v, tuple) else v for v in args))
    else:
        _starter(kernel, threads)(count, *args)


def _plain(value: Any) -> Any:
    """Return the members of tuples as functions compiled for the processor take them."""
    if isinstance(value, tuple):
        members = [_plain(member) for member in value]
        return type(value)(*members) if hasattr(value, "_fields") else tuple(members)
    return getattr(value, "_ary", value)


@cache
def _starter(kernel: Any, threads: int) -> Starter:
    return Starter(kernel, threads)


def empty(shape: int | tuple[int, ...], dtype: DTypeLike = np.float64) -> CardArray:
    """Return an array on the card with undefined content."""
    return _ready(cuda.device_array(shape, np.dtype(dtype)))


def zeros(shape: int | tuple[int, ...], dtype: DTypeLike = np.float64) -> CardArray:
    """Return an array of zeros on the card."""
    return upload(np.zeros(shape, dtype))


def upload(values: NDArray) -> CardArray:
    """Return a copy of an array on the card."""
    return _ready(cuda.to_device(np.ascontiguousarray(values)))


def _ready(array: CardArray) -> CardArray:
    """Keep the parameters of an array with it."""
    if not config.ENABLE_CUDASIM:
        array.packed = pack_array(array)
    return array


def reshaped(array: CardArray, *shape: int) -> CardArray:
    """Return the same numbers on the card in another shape."""
    return _ready(array.reshape(*shape))


class Mail:
    """Sends small arrays to the card without waiting for it.

    They lie in a ring of memory that the card can read by itself. When it has gone round, the card must have
    taken what lies there.

    Parameters
    ----------
    size : int
        Bytes of the ring. What is larger than half of it is sent while the host waits.
    """

    def __init__(self, size: int = 1 << 20) -> None:
        self._ring, self._next = cuda.pinned_array(size, np.uint8), 0

    def send(self, values: NDArray, target: CardArray) -> None:
        """Copy ``values`` to an array on the card."""
        size, room = values.nbytes, len(self._ring)
        if not size:
            return
        if size > room // 2:
            target.copy_to_device(values)
            return
        if self._next + size > room:
            cuda.synchronize()
            self._next = 0
        place = self._ring[self._next : self._next + size].view(values.dtype).reshape(values.shape)
        place[...] = values
        target.copy_to_device(place, stream=cuda.default_stream())
        self._next += -(-size // _ALIGNED) * _ALIGNED


def clear(array: CardArray) -> None:
    """Set all of an array on the card to zero."""
    flat = array if array.ndim == 1 else array.ravel()
    launch(_clear, flat.shape[0], flat)


@cuda.jit(cache=True)
def _clear(values):
    i = cuda.grid(1)
    if i < values.shape[0]:
        values[i] = 0
