# SPDX-License-Identifier: Apache-2.0
"""Arrays without a count of their users.

Every view of an array that a compiled loop makes is counted, by an instruction that waits for the memory: for
the sums of one particle that is a fifth of their time. A *lent* array is not counted, and neither are views
of it. Whoever lends has to hold the array itself until the last use.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba.core import cgutils, types
from numba.extending import intrinsic


@intrinsic
def lent(typingctx: Any, held_by: Any) -> tuple[Any, Callable]:
    """Return an array, or a tuple of them, without a count; valid until the original is :func:`held`."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _uncounted(context, builder, signature.return_type, args[0])

    return held_by(held_by), generate


@intrinsic
def held(typingctx: Any, original: Any) -> tuple[Any, Callable]:
    """Do nothing; what was lent is not given back before."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return context.get_dummy_value()

    return types.void(original), generate


def _uncounted(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    if hasattr(kind, "types"):  # a tuple, named or not
        parts = cgutils.unpack_tuple(builder, value)
        lent_parts = [
            _uncounted(context, builder, part, one) for part, one in zip(kind.types, parts, strict=True)
        ]
        return context.make_tuple(builder, kind, lent_parts)
    own, out = (context.make_array(kind)(context, builder, *given) for given in ((value,), ()))
    for part in ("data", "nitems", "itemsize", "shape", "strides"):
        setattr(out, part, getattr(own, part))
    for part in ("meminfo", "parent"):
        setattr(out, part, cgutils.get_null_value(getattr(out, part).type))
    return out._getvalue()
