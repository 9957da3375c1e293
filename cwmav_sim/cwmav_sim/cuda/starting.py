# SPDX-License-Identifier: Apache-2.0
"""Starting a compiled kernel without having its arguments looked at anew.

A step starts about a hundred kernels. The compiler's own way looks at the type of every argument each time
and makes a view of every array, 0.1 ms a start, which on a fast card is more than the kernels themselves
take. Here the parameters of an array are made when it is made, and the driver is called directly. Where the
compiler does not show what that needs, kernels are started in its own way: slower, with the same results.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cache
from itertools import chain
from typing import Any

import numpy as np

_SCALARS: dict[type, Any] = {
    bool: ctypes.c_bool,
    np.bool_: ctypes.c_bool,
    int: ctypes.c_int64,
    float: ctypes.c_double,
    np.int32: ctypes.c_int32,
    np.int64: ctypes.c_int64,
    np.float32: ctypes.c_float,
    np.float64: ctypes.c_double,
}


@dataclass(frozen=True, slots=True)
class Packed:
    """An argument as the driver takes it.

    Attributes
    ----------
    kind : hashable
        What the compiled kernel depends on.
    addresses : tuple of int
        Of its parameters, in the order of the compiler: an array counts as two unused pointers, size, size of
        an item, address, shape and strides, a tuple as its members.
    memory : object
        What lies at the addresses.
    """

    kind: Any
    addresses: tuple[int, ...]
    memory: Any


def pack_array(array: Any) -> Packed:
    """Return the parameters of an array on the card."""
    interface = array.__cuda_array_interface__
    values = (0, 0, array.size, array.dtype.itemsize, interface["data"][0], *array.shape, *array.strides)
    memory = (ctypes.c_int64 * len(values))(*values)
    first = ctypes.addressof(memory)
    addresses = tuple(range(first, first + 8 * len(values), 8))
    return Packed((array.dtype.str, array.ndim), addresses, memory)


def _pack(value: Any) -> Packed:
    packed = getattr(value, "packed", None)
    if packed is not None:
        return packed  # type: ignore[no-any-return]
    kind = type(value)
    if isinstance(value, tuple):
        kinds = tuple(map(type, value))
        return _pack_numbers(value, (kind, *kinds)) if _SCALARS.keys() >= set(kinds) else _pack_members(value)
    scalar = _SCALARS.get(kind)
    if scalar is None:
        return pack_array(value)
    memory = scalar(value)
    return Packed(kind, (ctypes.addressof(memory),), memory)


@cache
def _pack_numbers(values: tuple[Any, ...], kinds: tuple[type, ...]) -> Packed:
    """Return the parameters of a tuple of numbers; there are few, all of them constants of a solver."""
    return _pack_members(values)


def _pack_members(values: tuple[Any, ...]) -> Packed:
    members = [_pack(value) for value in values]
    addresses = tuple(chain.from_iterable(member.addresses for member in members))
    return Packed((type(values), *(member.kind for member in members)), addresses, members)


class Starter:
    """Starts one kernel, whatever types it has been compiled for.

    Parameters
    ----------
    kernel : object
        As the compiler's decorator returns it.
    threads : int
        Threads of a block.
    """

    def __init__(self, kernel: Any, threads: int) -> None:
        self._kernel, self._threads = kernel, threads
        self._functions: dict[tuple[Any, ...], Any] = {}  # by kinds of the arguments; None: unknown

    def __call__(self, blocks: int, *args: Any) -> None:
        """Start so many blocks."""
        packed = [_pack(value) for value in args]
        kinds = tuple(argument.kind for argument in packed)
        if kinds not in self._functions:
            self._functions[kinds] = self._start_and_find(blocks, args)
            return
        function = self._functions[kinds]
        if function is None:
            self._kernel[blocks, self._threads](*args)
            return
        addresses = list(chain.from_iterable(argument.addresses for argument in packed))
        parameters = (ctypes.c_void_p * len(addresses))(*addresses)
        _start(function, blocks, self._threads, ctypes.addressof(parameters))

    def _start_and_find(self, blocks: int, args: tuple[Any, ...]) -> Any:
        """Start in the compiler's way, and return what it compiled, or None where it does not show it."""
        before = set(self._kernel.overloads)
        self._kernel[blocks, self._threads](*args)
        new = [signature for signature in self._kernel.overloads if signature not in before]
        try:
            from cuda.bindings import driver  # type: ignore[import-untyped]

            (signature,) = new
            compiled = self._kernel.overloads[signature]
            return driver.CUfunction(int(compiled._codelibrary.get_cufunc().handle))
        except (ImportError, AttributeError, TypeError, ValueError):
            return None


def _start(function: Any, blocks: int, threads: int, parameters: int) -> None:
    from cuda.bindings import driver

    (error,) = driver.cuLaunchKernel(function, blocks, 1, 1, threads, 1, 1, 0, 0, parameters, 0)
    if error != driver.CUresult.CUDA_SUCCESS:
        raise RuntimeError(f"a kernel could not be started on the card ({error})")
