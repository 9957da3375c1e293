# SPDX-License-Identifier: Apache-2.0
"""Manners of the command-line programs: JSON, exit statuses, messages."""

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from cwmav_common.cli import app, emit, main_guard, plain
from cwmav_common.errors import InputError, WorkError
from cwmav_common.progress import progress


@dataclass(frozen=True)
class Point:
    x: float
    path: Path


def test_plain_makes_json_types_and_null_for_undefined_numbers():
    value = {
        "a": np.array([1.0, np.nan]),
        "b": np.float64(np.inf),
        "c": Point(1.0, Path("x")),
        "d": (np.int64(3),),
    }
    assert json.loads(json.dumps(plain(value), allow_nan=False)) == {
        "a": [1.0, None],
        "b": None,
        "c": {"x": 1.0, "path": "x"},
        "d": [3],
    }


def test_emit_prints_one_object_or_the_lines(capsys):
    emit({"value": 1.5}, True, ["never shown"])
    assert json.loads(capsys.readouterr().out) == {"value": 1.5}
    emit({"value": 1.5}, False, ["value  1.5 N"])
    assert capsys.readouterr().out == "value  1.5 N\n"


@pytest.mark.parametrize(
    ("error", "status", "text"),
    [
        (InputError("a.bag: not there"), 2, "error: a.bag: not there\n"),
        (WorkError("diverged at t = 1 s"), 1, "error: diverged at t = 1 s\n"),
        (KeyboardInterrupt(), 130, ""),
    ],
)
def test_failures_become_exit_statuses_without_traceback(monkeypatch, capsys, error, status, text):
    cli = app("prog", "help")

    @cli.command()
    def work() -> None:
        raise error

    monkeypatch.setattr(sys, "argv", ["prog"])
    with pytest.raises(SystemExit) as caught:
        main_guard(cli)()
    captured = capsys.readouterr()
    assert caught.value.code == status
    assert captured.err.endswith(text)
    assert "Traceback" not in captured.err
    assert captured.out == ""


def test_progress_is_silent_in_a_pipe(capsys):
    with progress(3, "work") as bar:
        bar.update(1, note="half")
        bar.advance_to(3)
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == ""


@pytest.mark.parametrize(
    ("arguments", "status", "text"),
    [(["--nonsense"], 2, "No such option"), (["--help"], 0, ""), (["--count", "many"], 2, "--count")],
)
def test_bad_usage_is_status_2(monkeypatch, capsys, arguments, status, text):
    cli = app("prog", "help")

    @cli.command()
    def work(count: int = 1) -> None:
        print(count)

    monkeypatch.setattr(sys, "argv", ["prog", *arguments])
    with pytest.raises(SystemExit) as caught:
        main_guard(cli)()
    assert caught.value.code == status
    assert text in capsys.readouterr().err
