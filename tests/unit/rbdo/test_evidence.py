# SPDX-License-Identifier: Apache-2.0
import importlib
import json
import re

import pytest

from cwmav_common.errors import InputError
from cwmav_rbdo.evidence import collect, summarise, table_lines, write_figure
from cwmav_rbdo.evidence.collect import METHODS, STUDIES, read
from cwmav_rbdo.evidence.studies import Outcome, made_on

collect_module = importlib.import_module("cwmav_rbdo.evidence.collect")


@pytest.fixture
def counted(monkeypatch):
    calls = []

    def study(method, q, seed):
        calls.append((method, q, seed))
        return Outcome(None if method == "classical" and seed else 10 + seed, 20, 0.01)

    monkeypatch.setitem(STUDIES, "paper_surface_2", study)
    return calls


def test_runs_are_continued_and_none_is_repeated(tmp_path, counted):
    path = tmp_path / "evidence.jsonl"
    collect(path, 1, ["paper_surface_2"])
    assert counted == [(method, q, 0) for method, q in METHODS.values()]
    with path.open("a") as file:
        file.write('{"study": "paper_surf')  # what a kill leaves
    collect(path, 2, ["paper_surface_2"])
    assert len(counted) == 2 * len(METHODS)
    assert len(read(path)) == 2 * len(METHODS)
    path.write_text(2 * path.read_text())  # two programs at once
    assert len(read(path)) == 2 * len(METHODS)


def test_another_lift_table_is_another_study(tmp_path, counted, monkeypatch):
    path = tmp_path / "evidence.jsonl"
    monkeypatch.setattr(collect_module, "made_on", lambda study: "lift table 1 of 8 runs")
    collect(path, 1, ["paper_surface_2"])
    monkeypatch.setattr(collect_module, "made_on", lambda study: "lift table 2 of 47 runs")
    collect(path, 1, ["paper_surface_2"])
    collect(path, 1, ["paper_surface_2"])
    assert len(counted) == 2 * len(METHODS)
    lines = "\n".join(table_lines(read(path)))
    assert "| paper_surface_2 (lift table 1 of 8 runs) | classical | 1 |" in lines
    assert "| paper_surface_2 (lift table 2 of 47 runs) | classical | 1 |" in lines
    assert re.fullmatch("lift table [0-9a-f]{8} of [0-9]+ runs", made_on("wing_table_2"))
    assert made_on("youn_choi_2d") == ""


def test_a_run_that_never_arrives_counts_as_the_slowest(tmp_path, counted):
    path = tmp_path / "evidence.jsonl"
    collect(path, 4, ["paper_surface_2"])
    classical, *_, ours = summarise(read(path))
    assert (classical["runs"], classical["reached"]) == (4, 1)
    assert classical["to_reach"] == [10.0, None, None]
    assert ours["to_reach"] == [10.0, 11.0, 12.0]
    lines = list(table_lines(read(path)))
    assert lines[2].startswith("| paper_surface_2 | classical | 4 | 1 | - [10, -] |")
    write_figure(read(path), tmp_path / "evidence.png")
    assert (tmp_path / "evidence.png").stat().st_size > 5000


def test_wrong_study_and_damaged_file_are_named(tmp_path):
    with pytest.raises(InputError, match="study 'moon' is unknown; allowed: paper_surface_2"):
        collect(tmp_path / "a.jsonl", 1, ["moon"])
    path = tmp_path / "b.jsonl"
    path.write_text("{}\n" + json.dumps({"study": "x"}) + "\n")
    with pytest.raises(InputError, match="b.jsonl: line 1 is no run of this comparison"):
        read(path)


def test_one_true_run_of_each_kind_reaches_the_optimum():
    wing = STUDIES["paper_surface_2"]("default", 0.25, 3)
    assert wing.reached is not None
    assert wing.reached <= 25
    assert wing.stopped is not None
    assert wing.gap < 0.005
    column = STUDIES["column_buckling_dubourg"]("zhang2026", 0.25, 0)
    assert column.reached is None or column.reached <= 80
