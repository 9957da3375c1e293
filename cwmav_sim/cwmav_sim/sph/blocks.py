# SPDX-License-Identifier: Apache-2.0
"""Operations on a few neighbouring entries at once, spelled out as vector instructions.

The runs of memory a buffer is filled from are shorter than an unrolled vector loop, so the compiler leaves
their copying to its scalar remainder; and no loop it knows keeps some entries and drops the others. A *block*
is what one copy takes, *lanes* are what is looked at at once: as much as a vector of the processor holds, 32
bytes or, where it brings marked lanes to the front by itself, 64.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir
from numba.core import cgutils, config, types
from numba.extending import intrinsic
from numpy.typing import NDArray

BLOCK = 16  # entries
_PLACES = 8  # of 4 bytes, among which lanes are put in order

_I8, _I32, _I64 = ir.IntType(8), ir.IntType(32), ir.IntType(64)
_FUSED = ("contract",)


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
        product = builder.fmul(_load(builder, origin, BLOCK), _splat(builder, scale, BLOCK))
        _store(builder, builder.fadd(product, _splat(builder, offset, BLOCK)), destination)
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
        product = builder.fmul(_load(builder, origin, BLOCK), _splat(builder, scale, BLOCK))
        _store(builder, builder.fadd(_load(builder, destination, BLOCK), product), destination)
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def set_block(typingctx: Any, target: Any, row: Any, at: Any, value: Any) -> tuple[Any, Callable]:
    """``target[row, at:at + 16] = value``, unchecked."""
    signature = types.void(target, row, at, value)

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        to, to_row, to_first, single = args
        destination = _address(context, builder, signature.args[0], to, (to_row, to_first))
        _store(builder, _splat(builder, single, BLOCK), destination)
        return context.get_dummy_value()

    return signature, generate


def lane_bytes() -> int:
    """Return how many bytes are looked at at once."""
    return 64 if has_compression() else 32


def lanes(dtype: np.dtype) -> int:
    """Return how many entries are looked at at once."""
    return lane_bytes() // dtype.itemsize


@intrinsic
def lanes_of(typingctx: Any, array: Any) -> tuple[Any, Callable]:
    """Return how many entries of an array are looked at at once."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return ir.Constant(_I64, lane_bytes() // (signature.args[0].dtype.bitwidth // 8))

    return types.int64(array), generate


def lane_orders(dtype: np.dtype) -> NDArray[np.uint64]:
    """Return, for every set of marked lanes, the order that brings these to the front.

    An order is eight bytes, each the place that a group of four bytes comes from; shape (2**lanes,). A
    processor that needs no order gets none.
    """
    if has_compression():
        return np.empty(0, np.uint64)
    count = lanes(dtype)
    groups = _PLACES // count
    orders = np.empty((2**count, _PLACES), np.uint8)
    for bits in range(2**count):
        marked = [lane for lane in range(count) if bits >> lane & 1]
        others = [lane for lane in range(count) if not bits >> lane & 1]
        orders[bits] = [groups * lane + part for lane in marked + others for part in range(groups)]
    return orders.view(np.uint64)[:, 0]


@intrinsic
def lanes_within(
    typingctx: Any, source: Any, first: Any, centre: Any, half: Any, reach2: Any
) -> tuple[Any, Callable]:
    """Return the set of lanes from ``first`` on whose points lie within reach of a box, as bits.

    Rows 0 to 2 of ``source`` are positions; ``centre`` and ``half`` are the middle and half the extent of the
    box, ``reach2`` is the square of the reach. No bounds are checked.
    """
    signature = types.uint64(source, first, centre, half, reach2)

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        of, of_first, middle, extent, limit = args
        total = None
        for axis in range(3):
            index = (ir.Constant(_I64, axis), of_first)
            origin = _address(context, builder, signature.args[0], of, index)
            width = lane_bytes() // _size(origin)
            centred = builder.fsub(
                _load(builder, origin, width), _splat(builder, builder.extract_value(middle, axis), width)
            )
            beyond = builder.fsub(
                _absolute(builder, centred), _splat(builder, builder.extract_value(extent, axis), width)
            )
            zero = ir.Constant(beyond.type, [0.0] * width)
            beyond = builder.select(builder.fcmp_ordered(">", beyond, zero), beyond, zero)
            square = builder.fmul(beyond, beyond, flags=_FUSED)
            total = square if total is None else builder.fadd(total, square, flags=_FUSED)
        marks = builder.fcmp_ordered("<", total, _splat(builder, limit, width))
        return builder.zext(builder.bitcast(marks, ir.IntType(width)), _I64)

    return signature, generate


@intrinsic
def copy_lanes(
    typingctx: Any, target: Any, at: Any, source: Any, first: Any, rows: Any, bits: Any, orders: Any
) -> tuple[Any, Callable]:
    """Copy a set of the lanes of ``source[rows, first:]`` to ``target[rows, at:]``, unchecked.

    ``rows`` are the first row and the one after the last, ``orders`` those of :func:`lane_orders`. Behind
    the lanes of the set, whatever else fits into a vector is overwritten.
    """
    signature = types.void(target, at, source, first, rows, bits, orders)

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        to, to_first, of, of_first, range_, marked, table = args
        begin, end = (builder.sext(builder.extract_value(range_, q), _I64) for q in range(2))
        single = _address(context, builder, signature.args[2], of, (begin, of_first)).type.pointee
        width = lane_bytes() // _size_of(single)
        order = _order(context, builder, signature.args[6], table, marked, width)
        with cgutils.for_range_slice(builder, begin, end, ir.Constant(_I64, 1), inc=True) as (row, _):
            origin = _address(context, builder, signature.args[2], of, (row, of_first))
            destination = _address(context, builder, signature.args[0], to, (row, to_first))
            _store(builder, _permuted(builder, _load(builder, origin, width), order), destination)
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def count_lanes(typingctx: Any, bits: Any) -> tuple[Any, Callable]:
    """Return the size of a set of lanes."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.call(builder.module.declare_intrinsic("llvm.ctpop", [_I64]), args)

    return types.int64(bits), generate


@intrinsic
def long_vectors(typingctx: Any) -> tuple[Any, Callable]:
    """Let the loops of the function that this is called in use the longest vectors of the processor.

    Where these are 64 bytes long, the compiler takes 32 unless told otherwise, for the sake of programs that
    use few of them.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        # Past the check of llvmlite, which knows attributes by name alone, and this one has a value.
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')
        return context.get_dummy_value()

    return types.void(), generate


def has_permutation() -> bool:
    """Return whether kernels are compiled for a processor that puts eight places in order at once."""
    return _has("avx2")


def has_compression() -> bool:
    """Return whether kernels are compiled for a processor that brings marked lanes to the front by itself."""
    return _has("avx512f")


def _has(feature: str) -> bool:
    plain = config.CPU_NAME is None and config.CPU_FEATURES is None
    return plain and bool(llvm.get_host_cpu_features().get(feature, False))


def _order(context: Any, builder: Any, kind: Any, orders: Any, bits: Any, width: int) -> Any:
    """Return the places, of groups of four bytes or of lanes, that bring a set of lanes to the front."""
    if not has_compression():
        places = builder.load(_address(context, builder, kind, orders, (bits,)))
        vector = builder.bitcast(places, ir.VectorType(_I8, _PLACES))
        return builder.zext(vector, ir.VectorType(_I32, _PLACES))
    lane = ir.IntType(8 * lane_bytes() // width)
    every = ir.Constant(ir.VectorType(lane, width), list(range(width)))
    marks = builder.bitcast(builder.trunc(bits, ir.IntType(width)), ir.VectorType(ir.IntType(1), width))
    name = f"llvm.x86.avx512.mask.compress.v{width}i{lane.width}"
    return _call(builder, name, every.type, [every, every, marks])


def _permuted(builder: Any, values: Any, order: Any) -> Any:
    if has_compression():
        kind = "df" if isinstance(values.type.element, ir.DoubleType) else "sf"
        return _call(builder, f"llvm.x86.avx512.permvar.{kind}.512", values.type, [values, order])
    groups = builder.bitcast(values, ir.VectorType(ir.FloatType(), _PLACES))
    if has_permutation():
        out = _call(builder, "llvm.x86.avx2.permps", groups.type, [groups, order])
    else:
        out = ir.Constant(groups.type, ir.Undefined)
        for place in range(_PLACES):
            index = ir.Constant(_I32, place)
            value = builder.extract_element(groups, builder.extract_element(order, index))
            out = builder.insert_element(out, value, index)
    return builder.bitcast(out, values.type)


def _call(builder: Any, name: str, kind: Any, operands: list) -> Any:
    declared = ir.FunctionType(kind, [operand.type for operand in operands])
    return builder.call(cgutils.get_or_insert_function(builder.module, declared, name), operands)


def _absolute(builder: Any, vector: Any) -> Any:
    bits = 8 * _size_of(vector.type.element)
    return _call(builder, f"llvm.fabs.v{vector.type.count}f{bits}", vector.type, [vector])


def _address(context: Any, builder: Any, kind: Any, array: Any, index: tuple) -> Any:
    """Pointer to an element of a C-contiguous array."""
    parts = context.make_array(kind)(context, builder, array)
    offset = index[-1]
    if len(index) == 2:
        length = builder.extract_value(parts.shape, 1)
        offset = builder.add(builder.mul(index[0], length), offset)
    return builder.gep(parts.data, [offset])


def _load(builder: Any, pointer: Any, width: int) -> Any:
    vector = ir.VectorType(pointer.type.pointee, width)
    return builder.load(builder.bitcast(pointer, vector.as_pointer()), align=_size(pointer))


def _store(builder: Any, values: Any, pointer: Any) -> None:
    builder.store(values, builder.bitcast(pointer, values.type.as_pointer()), align=_size(pointer))


def _splat(builder: Any, value: Any, width: int) -> Any:
    vector = ir.VectorType(value.type, width)
    single = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.Constant(_I32, 0))
    order = ir.Constant(ir.VectorType(_I32, width), [0] * width)
    return builder.shuffle_vector(single, ir.Constant(vector, ir.Undefined), order)


def _size(pointer: Any) -> int:
    return _size_of(pointer.type.pointee)


def _size_of(kind: Any) -> int:
    return 8 if isinstance(kind, ir.DoubleType) else 4
