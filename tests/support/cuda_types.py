# SPDX-License-Identifier: Apache-2.0
"""Compile every kernel for a card as far as that goes without one: types and intermediate code.

The simulator runs kernels as Python and sees no types, so it lets pass what no card would compile. Here the
solver makes a step in which every start of a kernel compiles it for the types of its arguments instead.
``python -m support.cuda_types`` prints the names of the kernels as one JSON list, ``... structure`` those of
the structure.
"""

import json
import sys

import numpy as np
from numba import cuda
from numba.cuda import compiler, dispatcher
from numba.cuda.typing.typeof import typeof

from cwmav_sim.cuda import crossing, launch, solver
from cwmav_sim.cuda.structure import CardArithmetic
from cwmav_sim.sph.settings import Resolution
from cwmav_sim.sph.sheet import SheetLoad
from support.cuda_checks import DP, HALF, TwoPlates, flow
from support.cuda_structure_checks import wings

CAPABILITY = (9, 0)


class HostArray(np.ndarray):
    """An array in the memory of the host with the methods of one on the card."""

    @property
    def __cuda_array_interface__(self):
        return self.__array_interface__

    def copy_to_host(self):
        return np.array(self)

    def copy_to_device(self, values, stream=0):
        self[...] = values


def _zeros(shape, dtype=np.float64):
    return np.zeros(shape, dtype).view(HostArray)


def _upload(values):
    return np.ascontiguousarray(values).view(HostArray)


class _Device:
    compute_capability = CAPABILITY


compiled = {}


def _plain(value):
    """Return an argument with arrays that the compiler knows."""
    if isinstance(value, tuple):
        members = [_plain(member) for member in value]
        return type(value)(*members) if hasattr(value, "_fields") else tuple(members)
    return np.asarray(value) if isinstance(value, np.ndarray) else value


def _compile(kernel, configuration):
    def start(*arguments):
        types = tuple(typeof(_plain(value), None) for value in arguments)
        if (kernel.py_func, types) not in compiled:
            options = {"fastmath": kernel.targetoptions.get("fastmath", False)}
            compiler.compile_cuda(kernel.py_func, None, types, cc=CAPABILITY, **options)
            compiled[kernel.py_func, types] = kernel.py_func.__name__

    return start


def prepare():
    """Let every start of a kernel compile it, with arrays in the memory of the host."""
    dispatcher.get_current_device = compiler.get_current_device = _Device
    cuda.pinned_array, cuda.default_stream = np.empty, lambda: None
    dispatcher.CUDADispatcher.__getitem__ = _compile
    for module in [m for name, m in sys.modules.items() if name.startswith("cwmav_sim.cuda.")]:
        for name, stand_in in (("empty", _zeros), ("zeros", _zeros), ("upload", _upload)):
            if hasattr(module, name):
                setattr(module, name, stand_in)


def air():
    settings = flow(HALF, resolution=Resolution(dp=DP, jitter=0.2))
    card = solver.CudaSolver(settings, TwoPlates(), 2.0)
    for _ in range(2):
        card.step()
    card.momentum()
    launch.launch(crossing._places, 1, 1, card._net._events, card._air.x, card._net._values)
    launch.launch(solver.confine_all, 1, card._air.x, card._air.v, *card._box)


def structure():
    for model in ("membrane", "lattice"):
        moving, card = wings(model), CardArithmetic()
        moving.bring(card)
        # Nothing is computed, so the first residual is given: one factorisation, solution and correction.
        sizes = iter([(1.0,) * 4])
        find = card.largest
        card.largest = lambda *fields, f=find, s=sizes: (
            next(s, (0.0,) * 4) if len(fields) == 4 else f(*fields)
        )
        nodes = moving.nodes(0.0)
        impacts, moving.structure.impacts = moving.structure.impacts, None
        impacts.find(nodes.x)
        impacts._free_time(nodes.x, nodes.v)
        load = SheetLoad(card.empty(len(nodes.x), 3), card.empty(len(nodes.x)))
        t = moving.structure.time + 9e-4  # divided in two
        moving.foresee(t, load)
        moving.accept(t, load)


if __name__ == "__main__":
    prepare()
    structure() if "structure" in sys.argv else air()
    print(json.dumps(sorted(compiled.values())))
