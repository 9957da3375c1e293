# SPDX-License-Identifier: Apache-2.0
"""Problem files (YAML or JSON): the one description of a study that command line, node and library share."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import yaml

from cwmav_common.cli import plain
from cwmav_common.errors import InputError
from cwmav_common.settings import from_mapping, read_yaml, to_mapping
from cwmav_rbdo.expressions import reference_text
from cwmav_rbdo.general_problem import KINDS, GeneralProblem
from cwmav_rbdo.wing_problem import WingProblem

Problem = WingProblem | GeneralProblem

# What collections of problems carry beside the problem itself: for comparison, not used to solve.
REFERENCE_KEYS = ("published", "recomputed", "f_opt", "x_opt", "low_fidelity", "source", "note")


def load_problem(path: str | Path) -> Problem:
    """Read a problem file; a bare name such as ``two_variables.yaml`` may be a bundled one.

    Raises
    ------
    InputError
        The file cannot be read or something in it is not allowed; the message names file, key and value.
    """
    found = find_problem(path)
    return parse_problem(read_yaml(found), str(path))


def find_problem(path: str | Path) -> Path:
    """Find a problem file, or a bundled one of that name."""
    path = Path(path)
    if path.is_file():
        return path
    bundled = bundled_problems()
    for name in (path.name, f"{path.name}.yaml"):
        if path.parent == Path(".") and name in bundled:
            return bundled[name]
    raise InputError(f"{path}: no such file; bundled problems: {', '.join(bundled)}")


def bundled_problems() -> dict[str, Path]:
    """Problem files of the package by name."""
    folder = Path(str(resources.files("cwmav_rbdo") / "config"))
    return {file.name: file for file in sorted(folder.glob("*.yaml"))}


def parse_problem(content: Mapping[str, Any], source: str) -> Problem:
    """Build a problem from the content of a problem file; `source` names it in error messages."""
    kind = content.get("kind")
    ignored = set(REFERENCE_KEYS)
    if kind == "lift_to_power":
        ignored.remove("source")  # here it says where lift, power and scatter come from
    content = {key: value for key, value in content.items() if key not in ignored}
    if kind == "lift_to_power":
        return from_mapping(WingProblem, _wing_content(content, source), source)
    if kind in KINDS:
        return from_mapping(GeneralProblem, _general_content(content, source), source)
    allowed = ", ".join(("lift_to_power", *KINDS))
    raise InputError(f"{source}: kind is {kind!r}; allowed: {allowed}")


def parse_text(text: str) -> Problem:
    """Read a problem given as a path or as the YAML text itself, as the optimise action takes it."""
    if "\n" not in text.strip() and "{" not in text:
        return load_problem(text.strip())
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise InputError(f"problem text: is not valid YAML ({' '.join(str(error).split())})") from None
    if not isinstance(content, dict):
        raise InputError("problem text: expected keys and values at the top")
    return parse_problem(content, "problem text")


def problem_mapping(problem: Problem) -> dict[str, Any]:
    """Give the resolved problem as plain values; :func:`parse_problem` reads them back."""
    mapping: dict[str, Any] = plain(_named(to_mapping(problem)))
    return mapping


def _named(value: Any) -> Any:
    """Put the name of every function of the user's in its place."""
    if isinstance(value, dict):
        return {key: _named(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_named(item) for item in value]
    return reference_text(value) if callable(value) else value


def digest(problem: Problem) -> str:
    """Fingerprint of what determines the answers: every setting except who evaluates and how patiently."""
    mapping = problem_mapping(problem)
    for key in ("dispatch", "evaluate", "title"):
        mapping.pop(key, None)
    if "source" in mapping:
        mapping["source"].pop("workers")
    return hashlib.sha256(json.dumps(mapping, sort_keys=True).encode()).hexdigest()[:16]


def _wing_content(content: dict[str, Any], source: str) -> dict[str, Any]:
    noise = content.get("noise", "measured")
    if noise == "measured":
        noise = None
    elif noise is not None and not isinstance(noise, dict):
        raise InputError(f"{source}: noise is {noise!r}; allowed: measured, or {{F: .., AoA: .., U: ..}}")
    return content | {"noise": noise}


def _general_content(content: dict[str, Any], source: str) -> dict[str, Any]:
    """Turn ``bounds: [[lo, hi], ...]`` into design variables x1, x2, ..."""
    bounds = content.pop("bounds", None)
    if bounds is None:
        return content
    if content.get("design"):
        raise InputError(f"{source}: bounds and design are both given; expected one of them")
    try:
        pairs = [(float(lo), float(hi)) for lo, hi in bounds]
    except (TypeError, ValueError):
        raise InputError(f"{source}: bounds is {bounds!r}; expected [[lo, hi], ...]") from None
    return content | {
        "design": [{"name": f"x{k + 1}", "lo": lo, "hi": hi} for k, (lo, hi) in enumerate(pairs)]
    }
