# SPDX-License-Identifier: Apache-2.0
"""Loads of two or four neighbouring numbers by one instruction.

A particle in cell order has three records: where it is (x, y, z, column), how it moves (velocity and volume)
and its state (density above rest and pressure). Whole records are loaded at once, because a pass over
neighbours waits for the number of its loads, not for the number of their bytes. The compiler joins loads by
itself only where it knows that the first address is a multiple of the whole; records begin at such addresses.
"""

from __future__ import annotations

from typing import Any

from numba import config

# Places in the records.
PLACE_X, PLACE_Y, PLACE_Z, COLUMN = range(4)
MOVE_X, MOVE_Y, MOVE_Z, VOLUME = range(4)
DENSITY, PRESSURE = range(2)
PLACE_SIZE, MOVE_SIZE, STATE_SIZE = 4, 4, 2

if config.ENABLE_CUDASIM:

    def four(records: Any, j: Any) -> Any:
        """Return the four numbers of record ``j`` of an array of shape (n, 4)."""
        return records[j, 0], records[j, 1], records[j, 2], records[j, 3]

    def two(records: Any, j: Any) -> Any:
        """Return the two numbers of record ``j`` of an array of shape (n, 2)."""
        return records[j, 0], records[j, 1]

else:
    from llvmlite import ir
    from numba.cuda import types
    from numba.cuda.extending import intrinsic

    def _loader(size: int) -> Any:
        def load(typing_context: Any, records: Any, j: Any) -> Any:
            """Return the numbers of record ``j`` of an array of shape (n, size)."""
            signature = types.UniTuple(records.dtype, size)(records, j)

            def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
                data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
                scalar = context.get_data_type(records.dtype)
                wide = builder.zext if not signature.args[1].signed else builder.sext
                index = arguments[1]
                if index.type.width < 64:
                    index = wide(index, ir.IntType(64))
                first = builder.mul(index, ir.Constant(ir.IntType(64), size))
                pointer = builder.bitcast(
                    builder.gep(data, [first]), ir.VectorType(scalar, size).as_pointer(data.type.addrspace)
                )
                record = builder.load(pointer)
                record.align = size * records.dtype.bitwidth // 8
                numbers = [
                    builder.extract_element(record, ir.Constant(ir.IntType(32), k)) for k in range(size)
                ]
                return context.make_tuple(builder, signature.return_type, numbers)

            return signature, generate

        return intrinsic(load)

    four = _loader(4)
    two = _loader(2)
