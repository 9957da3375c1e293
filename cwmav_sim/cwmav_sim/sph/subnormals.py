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
        builder.call(_mxcsr(builder, "stmxcsr"), [builder.bitcast(slot, _BYTE.as_pointer())])
        return builder.zext(builder.load(slot), _WORD)
    if processor == "aarch64":
        return builder.asm(ir.FunctionType(_WORD, []), "mrs $0, fpcr", "=r", [], side_effect=True)
    return ir.Constant(_WORD, 0)


def _write(builder: Any, mode: Any) -> None:
    processor = _processor(builder)
    if processor == "x86_64":
        slot = cgutils.alloca_once(builder, _HALF)
        builder.store(builder.trunc(mode, _HALF), slot)
        builder.call(_mxcsr(builder, "ldmxcsr"), [builder.bitcast(slot, _BYTE.as_pointer())])
    elif processor == "aarch64":
        builder.asm(ir.FunctionType(ir.VoidType(), [_WORD]), "msr fpcr, $0", "r", [mode], side_effect=True)


def _mxcsr(builder: Any, instruction: str) -> Any:
    """Return the LLVM intrinsic that stores or loads the control word of the vector unit."""
    name = f"llvm.x86.sse.{instruction}"
    if name in builder.module.globals:
        return builder.module.globals[name]
    return ir.Function(builder.module, ir.FunctionType(ir.VoidType(), [_BYTE.as_pointer()]), name)
