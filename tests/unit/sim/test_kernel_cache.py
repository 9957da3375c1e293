# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels must never outlive the source they were made from."""

import shutil
from pathlib import Path

import numba

import cwmav_sim
from cwmav_sim import fingerprint
from cwmav_sim.sph.forces import fluid_pass


def test_kernels_are_kept_under_the_fingerprint_of_the_solver():
    assert Path(numba.config.CACHE_DIR).name == f"kernels-{fingerprint.coupled_fingerprint()}"
    assert f"kernels-{fingerprint.coupled_fingerprint()}" in str(fluid_pass._cache.cache_path)


def test_an_edit_of_an_inlined_formula_changes_the_fingerprint(tmp_path, monkeypatch):
    source = Path(cwmav_sim.__file__).parent
    copy = tmp_path / "cwmav_sim"
    shutil.copytree(source, copy, ignore=shutil.ignore_patterns("__pycache__", "data"))
    monkeypatch.setattr(fingerprint, "__file__", str(copy / "fingerprint.py"))
    fresh = fingerprint.coupled_fingerprint.__wrapped__
    before = fresh()
    pair = copy / "sph" / "pair.py"
    text = pair.read_text()
    pair.write_text("# a remark\n" + text)
    assert fresh() == before
    pair.write_text(text.replace("four * (one - t) + one", "four * (one - t) + two"))
    assert fresh() != before
