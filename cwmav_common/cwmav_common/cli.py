# SPDX-License-Identifier: Apache-2.0
"""Manners of the three command-line programs: one JSON object or plain lines, and honest exit statuses."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import typer

from cwmav_common.errors import CwmavError


def app(name: str, help_text: str) -> typer.Typer:
    """Make the command group of one program."""
    return typer.Typer(
        name=name,
        help=help_text,
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
    )


def message(text: str) -> None:
    """Say something to the person, on standard error."""
    print(text, file=sys.stderr, flush=True)


def plain(value: Any) -> Any:
    """Turn dataclasses, arrays, paths and NumPy scalars into JSON types; NaN and infinities become null.

    JSON has no NaN, and a reader in another language must not fail on a quantity that is merely undefined.
    """
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def to_json(value: Any, indent: int | None = 2) -> str:
    """Serialise `value` by :func:`plain`."""
    return json.dumps(plain(value), indent=indent, allow_nan=False)


def emit(result: Mapping[str, Any], as_json: bool, lines: Iterable[str]) -> None:
    """Print the result: exactly one JSON object on standard output, or the lines for a person."""
    if as_json:
        print(to_json(result), flush=True)
    else:
        for line in lines:
            print(line, flush=True)


def main_guard(cli: typer.Typer) -> Callable[[], None]:
    """Wrap a command group into a console entry point that maps failures to exit statuses."""

    def main() -> None:
        try:
            cli()  # explains bad usage itself (status 2) and ends quietly on Ctrl-C (status 130)
        except CwmavError as error:
            message(f"error: {error}")
            raise SystemExit(error.exit_status) from None
        except BrokenPipeError:
            # The reader (for example `head`) went away; that is its right.
            sys.stderr.close()
            raise SystemExit(0) from None

    return main
