# SPDX-License-Identifier: Apache-2.0
"""Runs of several spacings side by side."""

import csv
from dataclasses import replace
from importlib import resources

import numpy as np
import pytest

from cwmav_common.errors import InputError
from cwmav_sim import case as cases
from cwmav_sim.spacing import bundled, change


def test_the_change_is_that_of_shared_points_with_a_lift_to_speak_of():
    reference = bundled("8 mm")
    shifted = replace(reference, lift=0.9 * reference.lift, dp=0.01)
    found = change(shifted, reference)
    assert found.points == np.count_nonzero(np.abs(reference.lift) > 0.05) < len(reference.lift)
    assert found.mean == pytest.approx(-0.1)
    assert found.std == pytest.approx(0.0, abs=1e-12)
    assert str(found) == (
        f"lifts at 10 mm differ from those at 8 mm by -10.0 +- 0.0 % ({found.points} points)"
    )


def test_spacings_without_shared_points_are_refused():
    reference = bundled("8 mm")
    moved = replace(reference, points=reference.points + 0.1)
    with pytest.raises(InputError, match="0 shared points above 0.05 N"):
        change(moved, reference)


def test_a_spacing_that_is_not_bundled_is_refused():
    with pytest.raises(InputError, match="'2 mm' has no bundled runs; allowed: 4 mm, 6 mm, 8 mm, 12 mm"):
        bundled("2 mm")


def test_larger_particles_lose_lift():
    found = change(bundled("12 mm"), bundled("8 mm"))
    assert found.points > 40
    assert -0.1 < found.mean < -0.03


def test_smaller_particles_change_less():
    coarser, finer = (abs(change(bundled(s), bundled("8 mm")).mean) for s in ("12 mm", "6 mm"))
    assert finer < coarser


def test_fast_wings_gain_at_the_papers_spacing():
    fine, reference = bundled("4 mm"), bundled("8 mm")
    fast = fine.points[:, 0] > 19.0
    found = change(replace(fine, points=fine.points[fast], lift=fine.lift[fast]), reference)
    assert found.points > 5
    assert found.mean - 2.0 * found.std > 0.0


@pytest.mark.parametrize("name", ["lift_12mm.csv", "lift_4mm.csv"])
def test_the_runs_are_those_of_their_presets(name):
    with (resources.files("cwmav_sim") / "data" / name).open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            point = float(row["F_hz"]), float(row["AoA_deg"]), float(row["U_m_s"])
            assert cases.preset(row["preset"]).at(*point).address(row["solver"]) == row["address"]
