# SPDX-License-Identifier: Apache-2.0
"""Take numbers too small for a normal floating-point number as zero, while a pass runs.

Air far from the wings moves by less than anything matters, and the repulsion of shifting falls with the
sixteenth power of the distance from the end of the support. In single precision much of that is subnormal,
smaller than 1.2e-38, and processors compute with subnormal numbers in microcode, many times slower. The
mode belongs to a thread, so whoever sets it puts the former one back.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

_X86_FLUSH = 0x8040  # flush to zero, and denormals are zero: bits 15 and 6 of MXCSR
_ARM_FLUSH = 1 << 24  # FZ of FPCR


@intrinsic
def flush_subnormals(typingctx: Any) -> tuple[Any, Callable]:
    """Set this thread to take subnormal numbers as zero; return its former mode for :func:`restore_mode`.

    On a processor other than x86-64 and AArch64 nothing happens.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        mode = _read(builder)
        _write(builder, builder.or_(mode, ir.Constant(_WORD, _flush_bits(builder))))
        return mode

    return types.uint64(), generate


@intrinsic
def restore_mode(typingctx: Any, mode: Any) -> tuple[Any, Callable]:
    """Put the mode of this thread back to what :func:`flush_subnormals` returned."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        _write(builder, args[0])
        return context.get_dummy_value()

    return types.void(types.uint64), generate


_WORD, _HALF, _BYTE = ir.IntType(64), ir.IntType(32), ir.IntType(8)


def _flush_bits(builder: Any) -> int:
    return {"x86_64": _X86_FLUSH, "aarch64": _ARM_FLUSH}.get(_processor(builder), 0)


def _processor(builder: Any) -> str:
    name = str(builder.module.triple).split("-")[0]
    return {"arm64": "aarch64", "amd64": "x86_64"}.get(name, name)


def _read(builder: Any) -> Any:
    processor = _processor(builder)
    if processor == "x86_64":
        slot = cgutils.alloca_once(builder, _HALF)
        store = _intrinsic(builder, "x86.sse.stmxcsr", ir.VoidType(), [_BYTE.as_pointer()])
        builder.call(store, [builder.bitcast(slot, _BYTE.as_pointer())])
        return builder.zext(builder.load(slot), _WORD)
    if processor == "aarch64":
        return builder.call(_intrinsic(builder, "aarch64.get.fpcr", _WORD, []), [])
    return ir.Constant(_WORD, 0)


def _write(builder: Any, mode: Any) -> None:
    processor = _processor(builder)
    if processor == "x86_64":
        slot = cgutils.alloca_once(builder, _HALF)
        builder.store(builder.trunc(mode, _HALF), slot)
        load = _intrinsic(builder, "x86.sse.ldmxcsr", ir.VoidType(), [_BYTE.as_pointer()])
        builder.call(load, [builder.bitcast(slot, _BYTE.as_pointer())])
    elif processor == "aarch64":
        builder.call(_intrinsic(builder, "aarch64.set.fpcr", ir.VoidType(), [_WORD]), [mode])


def _intrinsic(builder: Any, name: str, result: Any, arguments: list[Any]) -> Any:
    """Return the LLVM intrinsic of this name, declared at its first use."""
    full = f"llvm.{name}"
    known = builder.module.globals.get(full)
    return known or ir.Function(builder.module, ir.FunctionType(result, arguments), full)
