# SPDX-License-Identifier: Apache-2.0
"""The lift table that is shipped: made by this solver, with these settings, and sensible."""

import csv
import math
from importlib import resources

import pytest

from cwmav_sim import case as cases
from cwmav_sim.run import simulate
from cwmav_sim.table import LiftTable


@pytest.fixture(scope="module")
def rows():
    with (resources.files("cwmav_sim") / "data" / "lift_table.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def case_of(row):
    point = float(row["F_hz"]), float(row["AoA_deg"]), float(row["U_m_s"])
    return cases.preset(row["preset"]).at(*point)


def test_every_row_has_the_settings_of_its_preset(rows):
    for row in rows:
        assert case_of(row).address(row["solver"]) == row["address"]


def test_lift_grows_with_the_angle_of_attack():
    table = LiftTable.bundled()
    by_angle = [table.lift(16.0, math.radians(a), 3.0).lift for a in (5, 10, 20, 30)]
    assert by_angle == sorted(by_angle)


def test_estimate_says_its_error_and_source(rows):
    estimate = LiftTable.bundled().lift(16.0, math.radians(15), 3.0)
    assert 0.0 < estimate.lift_std < 0.05
    assert f"{len(rows)} SPH runs at 8 mm" in estimate.source
    assert rows[0]["solver"] in estimate.source
    assert estimate.inside


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_one_row_comes_out_again(rows):
    """A change of the solver that moves its numbers must be followed by a new table.

    The rows were made on a graphics card, this one comes from the processor.
    """
    row = min(rows, key=lambda r: float(r["wall_s"]))
    result = simulate(case_of(row))
    allowed = max(0.003, 2.0 * float(row["lift_std_n"]))
    assert result.mean_lift == pytest.approx(float(row["mean_lift_n"]), abs=allowed)
