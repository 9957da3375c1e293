# SPDX-License-Identifier: Apache-2.0
"""The how-to on problem files says only what works."""

import json
import re
from pathlib import Path

import pytest
import yaml

from cwmav_common.cli import main_guard
from cwmav_rbdo.benchmarks import benchmark_names
from cwmav_rbdo.cli import cli
from cwmav_rbdo.general_problem import RELIABILITY_METHODS
from cwmav_rbdo.problem import parse_problem

TEXT = (Path(__file__).parents[3] / "docs" / "how-to" / "problem-files.md").read_text()


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


def test_the_wing_studies_are_read():
    study, other, _ = (yaml.safe_load(block) for block in blocks("yaml"))
    assert parse_problem(study, "how-to").goal == "ratio"
    changed = parse_problem(study | other, "how-to")
    assert (changed.goal, changed.batch_size, changed.source.workers) == ("least_power", 4, 4)
    assert changed.distribution == {"AoA": "uniform"}
    assert parse_problem(study | {"source": {"coarse_lifts": "cases.csv"}}, "how-to").source.coarse_lifts


def test_the_column_is_solved_by_formula_and_by_the_function_of_the_page(tmp_path, monkeypatch, capsys):
    column = yaml.safe_load(blocks("yaml")[2])
    (tmp_path / "page_model.py").write_text("import numpy as np\n\n\n" + blocks("python")[0])
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    objectives = []
    for name, constraint in (("formula", column["constraints"][0]), ("named", "python:page_model:buckling")):
        (tmp_path / f"{name}.yaml").write_text(
            yaml.safe_dump(column | {"id": name, "constraints": [constraint]})
        )
        monkeypatch.setattr("sys.argv", ["cwmav-rbdo", "run", f"{name}.yaml", "--json"])
        with pytest.raises(SystemExit) as end:
            main_guard(cli)()
        found = json.loads(capsys.readouterr().out)
        assert end.value.code == 0
        assert found["converged"]
        assert found["constraints"][0]["met"]
        objectives.append(found["objective"])
    assert objectives[0] == pytest.approx(objectives[1], rel=1e-3)


def test_methods_and_the_number_of_problems_are_those_there_are():
    named = TEXT.split("names another method than active learning:")[1].split("or [your own]")[0]
    assert {m.strip() for m in named.split(",") if m.strip()} == set(RELIABILITY_METHODS) - {
        "active_learning"
    }
    assert f"solves {len(benchmark_names())} published problems" in TEXT
