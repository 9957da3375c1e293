# SPDX-License-Identifier: Apache-2.0
"""The lift table interpolates what it was given and knows how well."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import qmc

from cwmav_common.errors import InputError
from cwmav_sim import case as cases
from cwmav_sim.sweep import write_table
from cwmav_sim.table import LiftTable, TableRows, read_rows
from support.sim_results import result_for


def lift_law(points):
    frequency, angle, speed = points.T
    return (
        0.02 * speed**2 * np.sin(2 * angle) + 4e-4 * frequency**2 * np.sin(angle) + 1e-3 * np.cos(3 * angle)
    )


def rows(count=30, noise=0.0, seed=3):
    sample = qmc.LatinHypercube(d=3, rng=np.random.default_rng(seed)).random(count)
    low, high = np.array([4.0, math.radians(-10), 0.0]), np.array([30.0, math.radians(60), 6.0])
    points = low + sample * (high - low)
    lift = lift_law(points) + noise * np.random.default_rng(seed).normal(size=count)
    return TableRows(points, lift, np.full(count, noise), "smoke", 0.012, True, "0.1.0", "0123456789ab")


def test_interpolation_meets_a_smooth_law():
    table = LiftTable(rows())
    rng = np.random.default_rng(5)
    points = np.column_stack([rng.uniform(6, 28, 50), rng.uniform(0, 0.9, 50), rng.uniform(0.5, 5.5, 50)])
    found = np.array([table.lift(*point).lift for point in points])
    assert np.sqrt(np.mean((found - lift_law(points)) ** 2)) < 0.01
    assert table.loo_rms < 0.02


def test_leave_one_out_error_grows_with_the_noise():
    quiet, noisy = LiftTable(rows(noise=0.001)), LiftTable(rows(noise=0.03))
    assert noisy.loo_rms > 2 * quiet.loo_rms
    assert 0.02 < noisy.loo_rms < 0.08


def test_stated_deviation_covers_the_errors():
    table = LiftTable(rows(noise=0.01))
    rng = np.random.default_rng(9)
    points = np.column_stack([rng.uniform(4, 30, 200), rng.uniform(-0.17, 1.0, 200), rng.uniform(0, 6, 200)])
    estimates = [table.lift(*point) for point in points]
    scores = [(e.lift - truth) / e.lift_std for e, truth in zip(estimates, lift_law(points), strict=True)]
    assert np.mean(np.abs(scores) < 2.0) > 0.9


def test_far_outside_the_runs_the_deviation_covers_what_the_trend_leaves_open():
    everywhere = rows(count=60, noise=0.003)
    slow = everywhere.points[:, 0] < 16.0
    slow &= everywhere.points[:, 1] < math.radians(30.0)
    few = replace(
        everywhere,
        points=everywhere.points[slow],
        lift=everywhere.lift[slow],
        lift_std=everywhere.lift_std[slow],
    )
    table = LiftTable(few)
    corner = np.array([30.0, math.radians(60.0), 6.0])
    far, near = table.lift(*corner), table.lift(10.0, math.radians(10.0), 3.0)
    assert far.lift_std > 5.0 * near.lift_std
    assert abs(far.lift - lift_law(corner[None, :])[0]) < 3.0 * far.lift_std


def test_source_says_what_the_table_is():
    source = LiftTable(rows()).lift(16.0, 0.25, 3.5).source
    for part in ("lift table", "30 SPH runs at 12 mm", "half model", "smoke", "0.1.0", "0123456789ab"):
        assert part in source


def test_point_between_the_runs_is_inside_and_a_corner_is_not():
    table = LiftTable(rows())
    assert table.lift(16.0, math.radians(15), 3.5).inside
    assert not table.lift(4.0, math.radians(-10), 0.0).inside


@pytest.mark.parametrize(
    ("point", "message"),
    [
        ((40.0, 0.2, 3.0), "F is 40 Hz"),
        ((16.0, 2.0, 3.0), "AoA is 114.592 deg"),
        ((16.0, 0.2, -1.0), "U is -1 m/s"),
    ],
)
def test_points_outside_the_design_space_are_refused(point, message):
    with pytest.raises(InputError, match=message):
        LiftTable(rows()).lift(*point)


def test_too_few_rows_are_refused():
    with pytest.raises(InputError, match="5 rows"):
        LiftTable(rows(count=5))


def test_mixed_solvers_are_refused(tmp_path):
    base = cases.preset("smoke")
    write_table([result_for(base.at(8.0 + k, 10.0, 3.0), lift=0.1) for k in range(3)], tmp_path / "t.csv")
    text = (tmp_path / "t.csv").read_text().splitlines()
    solver = text[1].split(",")[-2]
    text[2] = text[2].replace(solver, "ffffffffffff")
    (tmp_path / "t.csv").write_text("\n".join(text))
    with pytest.raises(InputError, match="solver must be the same"):
        read_rows(tmp_path / "t.csv")


def test_table_that_is_none_is_refused(tmp_path):
    (tmp_path / "t.csv").write_text("F_hz,AoA_deg\n1,2\n")
    with pytest.raises(InputError, match="column U_m_s"):
        read_rows(tmp_path / "t.csv")
    with pytest.raises(InputError, match=r"absent\.csv"):
        read_rows(tmp_path / "absent.csv")
