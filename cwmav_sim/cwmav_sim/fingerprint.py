# SPDX-License-Identifier: Apache-2.0
"""The identity of the solver: a hash of the source that decides its numbers.

Comments, docstrings and layout do not count, so explaining the code better does not invalidate stored
results; any other change does, unless ``data/same_results.csv`` says that it changed no bit of any result.
Each of its rows names the hash of a source, the fingerprint whose results that source gives bit for bit, and
how this was shown; it is for changes that make the same sums faster, and the next edit leaves it behind.
"""

from __future__ import annotations

import ast
import csv
import hashlib
from functools import cache
from pathlib import Path

# Every module that a run with prescribed wings executes.
_NUMERICS = (
    "sph",
    "wing/sheet.py",
    "wing/geometry.py",
    "wing/prescribed.py",
    "solver.py",
    "kinematics.py",
    "taylor.py",
    "gauges.py",
)


# What a run with flexible wings executes besides.
_FLEXIBLE = (*_NUMERICS, "wing", "coupling.py")

_TRIES = 5  # of making a tree

_SAME_RESULTS = Path(__file__).parent / "data" / "same_results.csv"


@cache
def solver_fingerprint() -> str:
    """Return twelve hexadecimal digits that change when the results of prescribed wings may change."""
    return _results_of(_source_hash(_NUMERICS))


@cache
def coupled_fingerprint() -> str:
    """Return twelve hexadecimal digits that change when the results of flexible wings may change."""
    return _results_of(_source_hash(_FLEXIBLE))


@cache
def kernel_hash() -> str:
    """Return twelve hexadecimal digits that change with any edit of what compiled kernels are made from."""
    return _source_hash((*_FLEXIBLE, "cuda"))


def _results_of(source: str) -> str:
    with _SAME_RESULTS.open(encoding="utf-8", newline="") as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        return {row["source"]: row["results_of"] for row in rows}.get(source, source)


def _source_hash(names: tuple[str, ...]) -> str:
    root = Path(__file__).parent
    digest = hashlib.sha256()
    for path in _sources(root, names):
        digest.update(path.relative_to(root).as_posix().encode())
        digest.update(significant_source(path.read_text(encoding="utf-8")).encode())
    return digest.hexdigest()[:12]


def _sources(root: Path, names: tuple[str, ...]) -> list[Path]:
    found: list[Path] = []
    for name in names:
        path = root / name
        found += sorted(path.rglob("*.py")) if path.is_dir() else [path] if path.exists() else []
    return list(dict.fromkeys(found))


def significant_source(text: str) -> str:
    """Return a module as the interpreter sees it: without docstrings, comments and layout.

    What is written depends on the module alone, not on the version of Python that reads it: fields that are
    empty are left out, because new versions give old nodes new ones.
    """
    tree = _parsed(text)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list) and body and _is_docstring(body[0]):
            node.body = body[1:] or [ast.Pass()]  # type: ignore[attr-defined]
    return _written(tree)


def _parsed(text: str) -> ast.Module:
    """Return the tree of a module.

    CPython counts the depth of a tree in one place for all threads, and gives up when another tree is made
    meanwhile (its issue 106905).
    """
    for _ in range(_TRIES - 1):
        try:
            return ast.parse(text)
        except SystemError:
            continue
    return ast.parse(text)


def _written(node: object) -> str:
    if isinstance(node, ast.AST):
        fields = ((name, getattr(node, name, None)) for name in node._fields)
        filled = (f"{name}={_written(value)}" for name, value in fields if value not in (None, []))
        constant = isinstance(node, ast.Constant) and node.value is None
        return f"{type(node).__name__}({'None' if constant else ','.join(filled)})"
    if isinstance(node, list):
        return f"[{','.join(_written(item) for item in node)}]"
    return repr(node)


def _is_docstring(node: ast.stmt) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
