# SPDX-License-Identifier: Apache-2.0
"""What `make setup` says on a machine that lacks something."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TOOLS = ("sh", "make", "find", "printf", "tail", "touch", "echo", "rm")


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    """Make a checkout, and a folder of programs that holds only what every machine has."""
    shutil.copy(ROOT / "Makefile", tmp_path)
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    (tmp_path / "msgs_schema").mkdir()
    (tmp_path / "bin").mkdir()
    for tool in TOOLS:
        found = shutil.which(tool)
        assert found, tool
        (tmp_path / "bin" / tool).symlink_to(found)
    return tmp_path


def setup(machine: Path) -> subprocess.CompletedProcess[str]:
    environment = {key: value for key, value in os.environ.items() if key not in ("CC", "CXX", "PYTHON")}
    environment["PATH"] = str(machine / "bin")
    return subprocess.run(
        ["make", "setup"], cwd=machine, env=environment, capture_output=True, text=True, check=False
    )


def program(machine: Path, name: str, text: str) -> None:
    path = machine / "bin" / name
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)


def test_everything_missing_is_listed(machine: Path) -> None:
    done = setup(machine)
    assert done.returncode != 0
    assert "missing on this machine" in done.stderr
    for what in ("Python 3.11 or later", "a C compiler", "a C++ compiler"):
        assert what in done.stderr
    assert not (machine / ".venv").exists()


def test_an_old_python_is_named(machine: Path) -> None:
    program(machine, "python3", 'case "$1" in --version) echo Python 3.9.2;; *) exit 1;; esac')
    done = setup(machine)
    assert "Python 3.11 or later (found: Python 3.9.2)" in done.stderr


def test_a_python_without_venv_is_named(machine: Path) -> None:
    real = sys.executable
    program(machine, "python3", f'case "$2" in *ensurepip*) exit 1;; esac; exec {real} "$@"')
    for compiler in ("cc", "c++", "g++"):
        program(machine, compiler, "exit 0")
    done = setup(machine)
    assert done.returncode != 0
    assert "the venv module of python3" in done.stderr
    assert "compiler" not in done.stderr


def test_only_the_compiler_is_missing(machine: Path) -> None:
    (machine / "bin" / "python3").symlink_to(sys.executable)
    done = setup(machine)
    assert "a C compiler" in done.stderr
    assert "Python 3.11" not in done.stderr
