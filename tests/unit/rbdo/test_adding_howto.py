# SPDX-License-Identifier: Apache-2.0
"""The how-to on adding methods says only what works."""

import importlib
import json
import re
import shlex
import sys
from pathlib import Path

import pytest
from scipy.stats import norm

from cwmav_common.cli import main_guard
from cwmav_common.errors import InputError
from cwmav_rbdo.cli import cli
from cwmav_rbdo.plugins import resolve
from cwmav_rbdo.swarm import PyswarmsSwarm

HOW_TO = Path(__file__).parents[3] / "docs" / "how-to" / "adding-methods.md"


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", HOW_TO.read_text(), re.MULTILINE | re.DOTALL)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    for block in (*blocks("python"), *blocks("yaml")):
        name = block.splitlines()[0].removeprefix("# ")
        (tmp_path / name).write_text(block)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    for name in ("my_methods", "my_rules", "my_optimiser", "my_surface"):
        sys.modules.pop(name, None)


def run(command, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", [*shlex.split(command), "--json"])
    try:
        main_guard(cli)()
    except SystemExit as stop:
        if stop.code:
            pytest.fail(f"{command}: status {stop.code}, {capsys.readouterr().err}")
    return json.loads(capsys.readouterr().out)


def test_the_added_reliability_method_and_infill_rule_run(folder, monkeypatch, capsys):
    reliability, study, _ = (block.strip() for block in blocks("sh"))
    found = run(reliability, monkeypatch, capsys)
    assert found["method"] == "stratified"
    assert found["pf"] == pytest.approx(norm.sf(2.0), rel=0.3)
    result = run(study, monkeypatch, capsys)
    assert result["true_evaluations"] <= 20
    journal = (Path(result["run_folder"]) / "journal" / "journal.jsonl").read_text()
    assert "random in the window" in journal


def test_the_added_optimiser_and_surrogate_are_what_the_study_uses(folder, monkeypatch, capsys):
    used = []
    optimiser, surface = importlib.import_module("my_optimiser"), importlib.import_module("my_surface")
    minimise, learn = optimiser.Evolution.minimise, surface.RatioProcess._learn
    monkeypatch.setattr(
        optimiser.Evolution, "minimise", lambda *a, **k: used.append("optimiser") or minimise(*a, **k)
    )
    monkeypatch.setattr(surface.RatioProcess, "_learn", lambda *a: used.append("surrogate") or learn(*a))
    monkeypatch.setattr(PyswarmsSwarm, "minimise", lambda *a, **k: pytest.fail("not the one that was named"))
    result = run(blocks("sh")[2].strip(), monkeypatch, capsys)
    assert set(used) == {"optimiser", "surrogate"}
    assert result["true_evaluations"] <= 16
    best = max(row["response"] for row in result["history"])
    assert result["history"][0]["response"] <= best
    assert result["constraints"][0]["reliability"] > 0.9974


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("luck", "method is 'luck'; allowed: a, b, or python:package.module:function"),
        ("python:nowhere:f", "'python:nowhere:f' cannot be imported"),
        ("python:math:pi", "'python:math:pi' is a float, not a function"),
    ],
)
def test_a_name_that_leads_nowhere_is_refused(name, message):
    with pytest.raises(InputError, match=re.escape(message)):
        resolve(name, {"a": len, "b": len}, "method")
