# SPDX-License-Identifier: Apache-2.0
import json
from contextlib import closing

import numpy as np
import pytest

from cwmav_common.errors import InputError
from cwmav_rbdo.evaluation import Answer, Evaluation
from cwmav_rbdo.journal import Journal
from cwmav_rbdo.run_folder import RunFolder
from cwmav_rbdo.study import run_study
from support.ratio_bowl import NOISE, BowlEvaluator, small_problem

HEADER = {"problem": "abc", "seed": 1, "noise": {"F": 0.153}}
ANSWER = Answer(Evaluation(0.1, 1e-3, 0.9, 2e-3, "table", "rig"))


def journal(path, resume=False, header=HEADER):
    return closing(Journal(path, header, Evaluation, resume=resume))


def test_answers_and_points_come_back_bit_for_bit(tmp_path):
    path = tmp_path / "journal.jsonl"
    x = np.array([0.1 + 0.2, 1 / 3])
    with journal(path) as first:
        first.request(0, x, "initial")
        first.record(0, ANSWER)
        first.request(1, x + 1, "initial")
        first.record(1, Answer(None, "failed twice", 2))
    with journal(path, resume=True) as again:
        assert again.answer(0) == ANSWER
        assert again.answer(1) == Answer(None, "failed twice", 2)
        assert np.array_equal(again.request(0, x * (1 + 1e-9), "initial"), x)


def test_first_answer_stands(tmp_path):
    with journal(tmp_path / "j.jsonl") as book:
        book.record(0, ANSWER)
        book.record(0, Answer(None, "late"))
        assert book.answer(0) == ANSWER


def test_unfinished_last_line_is_dropped_and_overwritten(tmp_path):
    path = tmp_path / "j.jsonl"
    with journal(path) as book:
        book.request(0, np.array([1.0]), "initial")
        book.record(0, ANSWER)
    whole = path.read_bytes()
    path.write_bytes(whole + b'{"kind": "request", "id": 1, "x": [2.')
    with journal(path, resume=True) as again:
        again.request(1, np.array([3.0]), "initial")
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    assert [entry["kind"] for entry in lines] == ["header", "request", "answer", "request"]
    assert lines[-1]["x"] == [3.0]


def test_journal_of_another_run_is_refused_and_says_what_differs(tmp_path):
    path = tmp_path / "j.jsonl"
    with journal(path) as book:
        book.request(0, np.array([1.0]), "initial")
    with pytest.raises(InputError, match="j.jsonl.* with seed 1, this run has 2"):
        journal(path, resume=True, header=HEADER | {"seed": 2})
    with (
        journal(path, resume=True) as book,
        pytest.raises(InputError, match="request 0 is .* in the journal"),
    ):
        book.request(0, np.array([1.5]), "initial")
    with pytest.raises(InputError, match="exists already"):
        journal(path)


def test_damage_inside_a_journal_is_an_error_with_its_line(tmp_path):
    path = tmp_path / "j.jsonl"
    with journal(path):
        pass
    path.write_text(path.read_text() + "nonsense\n")
    with pytest.raises(InputError, match="line 2 is damaged"):
        journal(path, resume=True)
    with pytest.raises(InputError, match="no journal to resume"):
        journal(tmp_path / "absent.jsonl", resume=True)


@pytest.fixture(scope="module")
def undisturbed():
    """Do a run to its end, and its evaluator."""
    evaluator = BowlEvaluator()
    return run_study(small_problem(max_iterations=1), evaluator, seed=5, noise=NOISE), evaluator


@pytest.mark.parametrize("killed_after", [0, 3, 6, 9])
def test_killed_run_resumes_without_asking_for_a_point_twice(tmp_path, undisturbed, killed_after):
    problem = small_problem(max_iterations=1)
    expected, complete = undisturbed
    folder = RunFolder.create(tmp_path, "killed")
    before = BowlEvaluator(stop_after=killed_after)
    with pytest.raises(KeyboardInterrupt):
        run_study(problem, before, seed=5, run_folder=folder, noise=NOISE)
    after = BowlEvaluator()
    result = run_study(problem, after, seed=5, run_folder=folder, resume=True)
    assert before.points + after.points == complete.points
    assert len(before.points) == killed_after
    assert result.to_json() == expected.to_json()


def test_finished_run_resumed_evaluates_nothing(tmp_path):
    problem = small_problem(max_iterations=1)
    folder = RunFolder.create(tmp_path, "done")
    first = run_study(problem, BowlEvaluator(), seed=5, run_folder=folder, noise=NOISE)
    idle = BowlEvaluator()
    again = run_study(problem, idle, seed=5, run_folder=folder, resume=True)
    assert idle.points == []
    assert again.to_json() == first.to_json()
