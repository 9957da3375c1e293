# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels must never outlive the source they were made from, nor differ from the stored ones."""

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numba

import cwmav_sim
from cwmav_sim import fingerprint
from cwmav_sim.sph.forces import fluid_pass


def test_kernels_are_kept_under_the_hash_of_their_source():
    assert Path(numba.config.CACHE_DIR).name == f"kernels-{fingerprint.kernel_hash()}"
    assert f"kernels-{fingerprint.kernel_hash()}" in str(fluid_pass._cache.cache_path)


def test_an_edit_of_an_inlined_formula_changes_the_hash(tmp_path, monkeypatch):
    source = Path(cwmav_sim.__file__).parent
    copy = tmp_path / "cwmav_sim"
    shutil.copytree(source, copy, ignore=shutil.ignore_patterns("__pycache__", "data"))
    monkeypatch.setattr(fingerprint, "__file__", str(copy / "fingerprint.py"))
    fresh = fingerprint.kernel_hash.__wrapped__
    before = fresh()
    pair = copy / "sph" / "pair.py"
    text = pair.read_text()
    pair.write_text("# a remark\n" + text)
    assert fresh() == before
    pair.write_text(text.replace("f = t * t * t * volume", "f = t * t * volume"))
    edited = fresh()
    assert edited != before
    card = copy / "cuda" / "pair.py"
    card.write_text(card.read_text().replace("f = t * t * t * volume", "f = t * t * volume"))
    assert fresh() not in (before, edited)


def test_a_source_of_the_same_results_keeps_their_fingerprint_until_it_is_edited(tmp_path, monkeypatch):
    copy = tmp_path / "cwmav_sim"
    shutil.copytree(Path(cwmav_sim.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(fingerprint, "__file__", str(copy / "fingerprint.py"))
    monkeypatch.setattr(fingerprint, "_SAME_RESULTS", copy / "data" / "same_results.csv")
    identity = fingerprint.coupled_fingerprint.__wrapped__
    (copy / "data" / "same_results.csv").write_text("source,results_of,shown_by\n")
    source = identity()
    with (copy / "data" / "same_results.csv").open("a") as file:
        file.write(f"{source},0123456789ab,a test\n")
    assert identity() == "0123456789ab"
    with (copy / "sph" / "pair.py").open("a") as file:
        file.write("\nfour = 4\n")
    assert identity() not in ("0123456789ab", source)


def test_a_tree_that_another_thread_spoilt_is_made_again(monkeypatch):
    expected, parse, spoilt = fingerprint.significant_source("x = 1"), ast.parse, []

    def parse_later(text):
        if len(spoilt) < 2:
            spoilt.append(text)
            raise SystemError("AST constructor recursion depth mismatch")
        return parse(text)

    monkeypatch.setattr(ast, "parse", parse_later)
    assert fingerprint.significant_source("x = 1") == expected
    assert len(spoilt) == 2


TEN_STEPS = """
import hashlib
from cwmav_sim.case import preset, with_overrides
from cwmav_sim.solver import Solver
case = with_overrides(preset("smoke"), ["wing.model=membrane"])
solver = Solver(case.flow, case.motion(), case.airspeed, highest_speed=case.highest_speed())
for _ in range(10):
    solver.step()
print(hashlib.sha256((solver.velocity + 0.0).tobytes()).hexdigest())
"""


def test_a_process_that_compiles_computes_the_same_bits_as_one_that_loads(tmp_path):
    settings = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}

    def bits():
        command = [sys.executable, "-c", TEN_STEPS]
        return subprocess.run(command, env=settings, check=True, capture_output=True, text=True).stdout

    assert bits() == bits()
    assert any(tmp_path.rglob("*.nbi"))
