# SPDX-License-Identifier: Apache-2.0
"""Formulas of problem files, evaluated over rows of named values without ever calling ``eval``.

A formula is arithmetic over names, numbers and a fixed list of element-wise functions; the syntax tree is
checked against that list when the file is read and then run by ``asteval`` in its minimal configuration with
a symbol table of our own. ``python:package.module:function`` names a function of the user's own instead.
"""

from __future__ import annotations

import ast
import importlib
import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import asteval
import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import InputError, WorkError

Rows = Mapping[str, NDArray[np.float64]]

FUNCTIONS: Mapping[str, Callable[..., object]] = {
    name: getattr(np, name)
    for name in [
        "abs",
        "sqrt",
        "exp",
        "log",
        "log10",
        "sin",
        "cos",
        "tan",
        "arcsin",
        "arccos",
        "arctan",
        "arctan2",
        "sinh",
        "cosh",
        "tanh",
        "minimum",
        "maximum",
        "where",
        "hypot",
        "sign",
        "floor",
        "ceil",
    ]
}
CONSTANTS: Mapping[str, float] = {"pi": float(np.pi), "e": float(np.e)}

_NODES = (
    ast.Expression, ast.BinOp, ast.UnaryOp, ast.Compare, ast.Call, ast.Name, ast.Load, ast.Constant,
    ast.operator, ast.unaryop, ast.cmpop,
)  # fmt: skip
_HANDLED = {"binop", "unaryop", "compare", "call", "name", "constant", "expr", "module"}
_CONFIG = {node: node in _HANDLED for node in asteval.asteval.ALL_NODES}


class Function(Protocol):
    """A quantity computed for many rows at once."""

    @property
    def text(self) -> str:
        """As written in the problem file."""
        ...

    @property
    def names(self) -> tuple[str, ...] | None:
        """Names it uses; None when that cannot be known."""
        ...

    def __call__(self, rows: Rows) -> NDArray[np.float64]:
        """Evaluate over rows of equal length."""
        ...


@dataclass(frozen=True)
class Expression:
    """One formula; call it with arrays of equal length under the names it uses."""

    text: str
    names: tuple[str, ...]

    def __call__(self, rows: Rows) -> NDArray[np.float64]:
        """Evaluate over rows.

        Parameters
        ----------
        rows : mapping of name to (n,) array

        Returns
        -------
        (n,) array; where the formula is undefined it holds NaN or an infinity, which the caller must judge.
        """
        interpreter = asteval.Interpreter(
            symtable={**FUNCTIONS, **CONSTANTS, **rows}, use_numpy=False, minimal=True, config=dict(_CONFIG)
        )
        with np.errstate(all="ignore"):
            try:
                value = interpreter.run(ast.parse(self.text), expr=self.text)
            except Exception as error:
                raise WorkError(
                    f"'{self.text}' cannot be evaluated: {' '.join(str(error).split())}"
                ) from None
        return _column(value, rows, self.text)


@dataclass(frozen=True)
class Reference:
    """A function of the user's own; it receives arrays by name and returns one value per row."""

    text: str
    function: Callable[..., object]
    names: tuple[str, ...] | None

    def __call__(self, rows: Rows) -> NDArray[np.float64]:
        """Evaluate over rows; see :meth:`Expression.__call__`."""
        chosen = rows if self.names is None else {name: rows[name] for name in self.names}
        return _column(self.function(**chosen), rows, self.text)


def compile_function(text: object, known: Iterable[str], source: str) -> Function:
    """Turn a formula or a ``python:`` reference into a function over rows.

    Parameters
    ----------
    text : formula, ``python:package.module:function``, or the function itself
    known : names that will be present when it is evaluated
    source : how an error message should call the place it was read from

    Raises
    ------
    InputError
        The text is no arithmetic, uses an unknown name or function, or the reference cannot be imported.
    """
    names = tuple(known)
    if callable(text):
        return Reference(reference_text(text), text, _arguments(text, names, reference_text(text), source))
    if not isinstance(text, str | int | float) or isinstance(text, bool):
        raise InputError(f"{source}: {text!r} is no formula; expected text such as 'b*h**2 - 3'")
    text = str(text).strip()
    if text.startswith("python:"):
        return _reference(text, names, source)
    return Expression(text, _names_used(text, names, source))


def reference_text(function: Callable[..., object]) -> str:
    """Name a function as a problem file would; only what a module holds can be found by it again."""
    name = getattr(function, "__qualname__", type(function).__name__)
    return f"python:{getattr(function, '__module__', '?')}:{name}"


def _names_used(text: str, known: Sequence[str], source: str) -> tuple[str, ...]:
    try:
        tree = ast.parse(text, mode="eval")
    except (SyntaxError, ValueError) as error:
        raise InputError(f"{source}: '{text}' is not a formula ({error})") from None
    used: list[str] = []
    called = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    for node in ast.walk(tree):
        if not isinstance(node, _NODES) or isinstance(node, ast.MatMult):
            raise InputError(
                f"{source}: '{text}' uses {type(node).__name__}; allowed are numbers, names, "
                f"+ - * / // % **, comparisons and calls of {', '.join(FUNCTIONS)}"
            )
        if isinstance(node, ast.Call) and (not isinstance(node.func, ast.Name) or node.keywords):
            raise InputError(f"{source}: '{text}' calls something other than one of {', '.join(FUNCTIONS)}")
        if isinstance(node, ast.Constant) and (
            isinstance(node.value, bool) or not isinstance(node.value, int | float)
        ):
            raise InputError(f"{source}: '{text}' contains {node.value!r}; only numbers are allowed")
        if isinstance(node, ast.Name):
            allowed = list(FUNCTIONS) if id(node) in called else [*known, *CONSTANTS]
            if node.id not in allowed:
                raise InputError(f"{source}: '{text}' uses '{node.id}'; allowed here: {', '.join(allowed)}")
            if node.id in known:
                used.append(node.id)
    return tuple(dict.fromkeys(used))


def _reference(text: str, known: Sequence[str], source: str) -> Reference:
    parts = text.split(":")
    if len(parts) != 3 or not all(parts):
        raise InputError(f"{source}: '{text}' is no reference; expected python:package.module:function")
    try:
        function = getattr(importlib.import_module(parts[1]), parts[2])
    except (ImportError, AttributeError) as error:
        raise InputError(f"{source}: '{text}' cannot be imported ({error})") from None
    if not callable(function):
        raise InputError(f"{source}: '{text}' is a {type(function).__name__}, not a function")
    return Reference(text, function, _arguments(function, known, text, source))


def _arguments(
    function: Callable[..., object], known: Sequence[str], text: str, source: str
) -> tuple[str, ...] | None:
    """Names to pass; None when the function takes any."""
    parameters = inspect.signature(function).parameters.values()
    if any(p.kind is p.VAR_KEYWORD for p in parameters):
        return None
    wanted = [p.name for p in parameters if p.kind is not p.VAR_POSITIONAL]
    needed = {p.name for p in parameters if p.default is p.empty and p.kind is not p.VAR_POSITIONAL}
    unknown = sorted(needed - set(known))
    if unknown:
        raise InputError(
            f"{source}: '{text}' asks for {', '.join(unknown)}; the problem offers {', '.join(known)}"
        )
    return tuple(name for name in wanted if name in known)


def _column(value: object, rows: Rows, text: str) -> NDArray[np.float64]:
    n = next((len(column) for column in rows.values()), 1)
    try:
        column = np.asarray(value, dtype=float)
        return np.array(np.broadcast_to(column, (n,)))
    except (TypeError, ValueError):
        raise WorkError(f"'{text}' gave {type(value).__name__}, expected one number per row ({n})") from None
