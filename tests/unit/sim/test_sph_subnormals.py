# SPDX-License-Identifier: Apache-2.0
"""Subnormal numbers count as zero inside a pass and only there."""

import platform

import llvmlite.binding as llvm
import numba as nb
import numpy as np
import pytest
from llvmlite import ir

from cwmav_sim.sph import subnormals
from cwmav_sim.sph.pair import WORK_ROWS, pair_constants, sum_pairs
from cwmav_sim.sph.subnormals import flush_subnormals, restore_mode

KNOWN = platform.machine().lower() in ("x86_64", "amd64", "aarch64", "arm64")
TINY = np.float32(2e-38)  # half of it is subnormal


@nb.njit
def halves(values, flush, out):
    """Halve values in a loop that a compiler cannot move across the switch of the mode."""
    mode = flush_subnormals() if flush else np.uint64(0)
    for i in range(values.shape[0]):
        out[i] = values[i] * np.float32(0.5)
    if flush:
        restore_mode(mode)


def halved(flush):
    out = np.empty(64, np.float32)
    halves(np.full(64, TINY), flush, out)
    return out


@pytest.mark.skipif(not KNOWN, reason="this processor has no such mode here")
def test_subnormal_results_become_zero_in_between_and_stay_afterwards():
    assert (halved(False) > 0.0).all()
    assert (halved(True) == 0.0).all()
    assert (halved(False) > 0.0).all()
    assert np.float32(1e-38) * np.float32(0.1) > 0.0


@pytest.mark.parametrize(
    ("triple", "instructions"),
    [
        ("x86_64-unknown-linux-gnu", ("stmxcsr", "ldmxcsr")),
        ("aarch64-unknown-linux-gnu", ("FPCR",)),
        ("riscv64-unknown-linux-gnu", ()),
    ],
)
def test_machine_code_of_every_processor(triple, instructions):
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    module = ir.Module()
    module.triple = triple
    function = ir.Function(module, ir.FunctionType(ir.IntType(64), []), "both")
    builder = ir.IRBuilder(function.append_basic_block())
    mode = subnormals._read(builder)
    subnormals._write(builder, mode)
    builder.ret(mode)
    machine = llvm.Target.from_triple(triple).create_target_machine()
    text = machine.emit_assembly(llvm.parse_assembly(str(module)))
    assert all(name in text for name in instructions)


@nb.njit
def both(a, factors, buf, k, n, work, sums):
    for row in range(2):
        mode = flush_subnormals() if row else np.uint64(0)
        found = sum_pairs(a, factors, buf, buf[8], n, k, True, work)
        for q in range(7):
            sums[row, q] = found[q]
        if row:
            restore_mode(mode)


def test_sums_over_pairs_keep_every_digit():
    draw = np.random.default_rng(2)
    buf = draw.uniform(-1.0, 1.0, (9, 512)).astype(np.float32)
    buf[:3] *= 2.5e-2
    buf[8] = 1e-6
    a = tuple(np.float32(v) for v in (0.0, 0.0, 0.0, 1.0, -0.5, 0.2, 0.01, 3.0))
    k = pair_constants(1e-2, 1.2, 1e5, 2.5e5, 0.2, np.dtype(np.float32))
    sums = np.empty((2, 7), np.float32)
    factors = (np.float32(0.3), np.float32(0.7))
    both(a, factors, buf, k, 512, np.empty((WORK_ROWS, 512), np.float32), sums)
    assert np.abs(sums).min() > 0.0
    assert (sums[0] == sums[1]).all()
