# SPDX-License-Identifier: Apache-2.0
"""Looks up a rule or method by name: the package's own, or ``python:package.module:name`` of the user's."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from cwmav_common.errors import InputError

F = TypeVar("F", bound=Callable[..., Any])


def resolve(name: str, known: Mapping[str, F], key: str) -> F:
    """Give the function behind a name.

    Parameters
    ----------
    name : key of `known`, or ``python:package.module:function``
    known : the package's own
    key : setting that the name was read from

    Raises
    ------
    InputError
        There is none of that name, or the reference cannot be imported or is no function.
    """
    if name in known:
        return known[name]
    parts = name.split(":")
    if parts[0] != "python" or len(parts) != 3 or not all(parts):
        raise InputError(f"{key} is '{name}'; allowed: {', '.join(known)}, or python:package.module:function")
    try:
        found = getattr(importlib.import_module(parts[1]), parts[2])
    except (ImportError, AttributeError) as error:
        raise InputError(f"{key}: '{name}' cannot be imported ({error})") from None
    if not callable(found):
        raise InputError(f"{key}: '{name}' is a {type(found).__name__}, not a function")
    function: F = found
    return function
