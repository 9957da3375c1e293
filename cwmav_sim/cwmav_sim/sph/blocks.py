# SPDX-License-Identifier: Apache-2.0
"""Copies of sixteen neighbouring entries at once.

The runs of memory a buffer is filled from are shorter than an unrolled vector loop, so the compiler leaves
their copying to its scalar remainder. These two operations are spelled out as vector instructions instead.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

BLOCK = 16  # entries


@intrinsic
def scaled_block(
    typingctx: Any,
    target: Any,
    row: Any,
    at: Any,
    source: Any,
    source_row: Any,
    first: Any,
    factor: Any,
    shift: Any,
) -> tuple[Any, Callable]:
    """``target[row, at:at + 16] = factor * source[source_row, first:first + 16] + shift``, unchecked."""
    signature = types.void(target, row, at, source, source_row, first, factor, shift)

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        to, to_row, to_first, of, of_row, of_first, scale, offset = args
        destination = _address(context, builder, signature.args[0], to, (to_row, to_first))
        origin = _address(context, builder, signature.args[3], of, (of_row, of_first))
        product = builder.fmul(_load(builder, origin), _splat(builder, scale))
        _store(builder, builder.fadd(product, _splat(builder, offset)), destination)
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def add_block(
    typingctx: Any, target: Any, row: Any, at: Any, source: Any, first: Any, factor: Any
) -> tuple[Any, Callable]:
    """``target[row, at:at + 16] += factor * source[first:first + 16]``, unchecked."""
    signature = types.void(target, row, at, source, first, factor)

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        to, to_row, to_first, of, of_first, scale = args
        destination = _address(context, builder, signature.args[0], to, (to_row, to_first))
        origin = _address(context, builder, signature.args[3], of, (of_first,))
        product = builder.fmul(_load(builder, origin), _splat(builder, scale))
        _store(builder, builder.fadd(_load(builder, destination), product), destination)
        return context.get_dummy_value()

    return signature, generate


def _address(context: Any, builder: Any, kind: Any, array: Any, index: tuple) -> Any:
    """Pointer to an element of a C-contiguous array."""
    parts = context.make_array(kind)(context, builder, array)
    offset = index[-1]
    if len(index) == 2:
        length = builder.extract_value(parts.shape, 1)
        offset = builder.add(builder.mul(index[0], length), offset)
    return builder.gep(parts.data, [offset])


def _load(builder: Any, pointer: Any) -> Any:
    vector = ir.VectorType(pointer.type.pointee, BLOCK)
    return builder.load(builder.bitcast(pointer, vector.as_pointer()), align=_width(pointer))


def _store(builder: Any, values: Any, pointer: Any) -> None:
    builder.store(values, builder.bitcast(pointer, values.type.as_pointer()), align=_width(pointer))


def _splat(builder: Any, value: Any) -> Any:
    vector = ir.VectorType(value.type, BLOCK)
    single = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    order = ir.Constant(ir.VectorType(ir.IntType(32), BLOCK), [0] * BLOCK)
    return builder.shuffle_vector(single, ir.Constant(vector, ir.Undefined), order)


def _width(pointer: Any) -> int:
    return 8 if isinstance(pointer.type.pointee, ir.DoubleType) else 4
