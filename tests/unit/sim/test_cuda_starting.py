# SPDX-License-Identifier: Apache-2.0
"""Kernels started directly: parameters as the compiler lays them out, or its own way."""

import ctypes
import sys
from types import ModuleType, SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest

from cwmav_sim.cuda import starting
from cwmav_sim.cuda.starting import Starter, pack_array

pytest.importorskip("numba_cuda")


class OnCard(np.ndarray):
    """An array of the host that looks like one of the card."""

    @property
    def __cuda_array_interface__(self):
        return self.__array_interface__


def on_card(shape, dtype):
    return np.zeros(shape, dtype).view(OnCard)


class Compiled:
    """A kernel as the compiler returns it; its types are known after its first start."""

    def __init__(self, shown=True):
        self.overloads, self.started, self._shown = {}, [], shown

    def __getitem__(self, configuration):
        def start(*args):
            self.started.append((configuration, args))
            if self._shown:
                signature = tuple(type(a) if not isinstance(a, np.ndarray) else a.dtype.str for a in args)
                function = SimpleNamespace(handle=len(self.overloads) + 1)
                library = SimpleNamespace(get_cufunc=lambda: function)
                self.overloads.setdefault(signature, SimpleNamespace(_codelibrary=library))

        return start


@pytest.fixture
def direct(monkeypatch):
    """Collect what would be started directly."""
    seen = []
    driver = ModuleType("driver")
    driver.CUfunction = int
    bindings = ModuleType("cuda.bindings")
    bindings.driver = driver
    monkeypatch.setitem(sys.modules, "cuda.bindings", bindings)
    monkeypatch.setattr(starting, "_start", lambda *args: seen.append(args))
    return seen


def values(packed, kinds):
    return [kind.from_address(at).value for kind, at in zip(kinds, packed.addresses, strict=True)]


def test_an_array_is_two_unused_pointers_sizes_address_shape_and_strides():
    array = on_card((3, 5), np.float32)
    packed = pack_array(array)
    found = values(packed, [ctypes.c_int64] * 9)
    assert found == [0, 0, 15, 4, array.ctypes.data, 3, 5, 20, 4]
    assert packed.kind != pack_array(on_card((3, 5), np.float64)).kind
    assert packed.kind != pack_array(on_card(15, np.float32)).kind
    assert packed.kind == pack_array(on_card((7, 2), np.float32)).kind


def test_numbers_keep_their_width_and_tuples_are_their_members():
    arguments = (True, 7, 0.25, np.float32(1.5), (np.int32(3), np.float32(2.5)))
    kinds = [ctypes.c_bool, ctypes.c_int64, ctypes.c_double, ctypes.c_float, ctypes.c_int32, ctypes.c_float]
    packed = [starting._pack(argument) for argument in arguments]
    addresses = [at for one in packed for at in one.addresses]
    found = [kind.from_address(at).value for kind, at in zip(kinds, addresses, strict=True)]
    assert found == [True, 7, 0.25, 1.5, 3, 2.5]


class Pair(NamedTuple):
    field: np.ndarray
    factor: float


def test_tuples_with_arrays_are_their_members_and_kept_by_nobody():
    first, second = on_card((2, 3), np.float64), on_card((2, 3), np.float64)
    found = [starting._pack((3, Pair(array, 0.5))) for array in (first, second)]
    kinds = [ctypes.c_int64, *[ctypes.c_int64] * 9, ctypes.c_double]
    for packed, array in zip(found, (first, second), strict=True):
        numbers = values(packed, kinds)
        assert (numbers[0], numbers[5], numbers[-1]) == (3, array.ctypes.data, 0.5)
    assert found[0].kind == found[1].kind
    assert found[0].kind != starting._pack((3, (first, 0.5))).kind


def test_equal_tuples_of_other_types_are_not_taken_for_one():
    narrow, wide = (np.float32(1.0),), (np.float64(1.0),)
    assert starting._pack(narrow).kind != starting._pack(wide).kind
    assert ctypes.c_double.from_address(starting._pack(wide).addresses[0]).value == 1.0


def test_the_first_start_is_the_compilers_and_the_next_are_direct(direct):
    kernel = Compiled()
    start = Starter(kernel, 128)
    array = on_card(4, np.float64)
    start(9, array, 0.5)
    assert kernel.started == [((9, 128), (array, 0.5))]
    assert direct == []
    start(7, array, 0.75)
    assert len(kernel.started) == 1
    ((function, blocks, threads, parameters),) = direct
    assert (function, blocks, threads) == (1, 7, 128)
    assert parameters != 0
    start(7, array, 2)  # another type: compiled anew
    assert len(kernel.started) == 2
    start(7, array, 3)
    assert direct[-1][0] == 2


def test_a_compiler_that_does_not_show_its_functions_starts_all(direct):
    kernel = Compiled(shown=False)
    start = Starter(kernel, 64)
    for _ in range(3):
        start(2, 1.0)
    assert len(kernel.started) == 3
    assert direct == []


def test_a_start_that_the_driver_refuses_is_an_error(monkeypatch):
    driver = ModuleType("driver")
    driver.cuLaunchKernel = lambda *args: ("no such function",)
    driver.CUresult = SimpleNamespace(CUDA_SUCCESS="success")
    bindings = ModuleType("cuda.bindings")
    bindings.driver = driver
    monkeypatch.setitem(sys.modules, "cuda.bindings", bindings)
    with pytest.raises(RuntimeError, match=r"could not be started on the card \(no such function\)"):
        starting._start(1, 1, 1, 0)
