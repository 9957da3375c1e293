# SPDX-License-Identifier: Apache-2.0
"""The robust line and its covariance, on points whose truth is known."""

import numpy as np
import pytest

from cwmav_rig.angle.robust import fit_line, fit_linear
from cwmav_rig.angle.sampling import derivative_kernel, neighbour_correlation, noise_level, sample_offsets


def points_on_line(angle, count=60, noise=0.0, seed=0):
    along = np.linspace(-120, 120, count)
    across = noise * np.random.default_rng(seed).standard_normal(count)
    direction, normal = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    return np.array([200.0, 100.0]) + along[:, None] * direction + across[:, None] * normal


@pytest.mark.parametrize("angle_deg", [-89.0, -45.0, 0.0, 12.3, 60.0, 89.5])
def test_points_on_a_line_give_its_direction(angle_deg):
    points = points_on_line(np.deg2rad(angle_deg))
    line = fit_line(points, np.arange(60), np.ones(60))
    assert np.rad2deg(line.angle) == pytest.approx(angle_deg, abs=1e-7)
    assert line.angle_std < 1e-9


def test_turning_all_points_turns_the_line_and_nothing_else():
    points = points_on_line(0.2, noise=0.4, seed=1)
    line = fit_line(points, np.arange(60), np.ones(60))
    c, s = np.cos(1.0), np.sin(1.0)
    turned = fit_line(points @ np.array([[c, s], [-s, c]]), np.arange(60), np.ones(60))
    assert turned.angle - line.angle == pytest.approx(1.0, abs=1e-8)
    assert turned.angle_std == pytest.approx(line.angle_std, rel=1e-6)


def test_white_noise_gives_the_textbook_standard_error():
    along = np.linspace(-120, 120, 60)
    expected = 0.3 / np.sqrt((along**2).sum() * 0.95)  # the biweight is 95 % efficient
    stds, errors = [], []
    for seed in range(300):
        line = fit_line(points_on_line(0.3, noise=0.3, seed=seed), np.arange(60), np.ones(60))
        stds.append(line.angle_std)
        errors.append(line.angle - 0.3)
    assert np.sqrt(np.mean(np.square(stds))) == pytest.approx(expected, rel=0.12)
    assert np.std(errors) == pytest.approx(expected, rel=0.12)


def test_a_third_of_wild_points_on_one_side_hardly_move_the_line():
    points = points_on_line(0.1, noise=0.1, seed=3)
    points[::3, 1] += 15.0
    line = fit_line(points, np.arange(60), np.ones(60))
    assert line.angle == pytest.approx(0.1, abs=4 * line.angle_std)
    assert line.angle_std < 5e-4
    assert np.all(line.weights[::3] == 0)


def test_poor_points_count_less_and_the_standard_error_knows():
    std = np.where(np.arange(60) < 30, 0.1, 0.5)
    covered, knowing, blind = 0, [], []
    for seed in range(200):
        points = points_on_line(0.0)
        points[:, 1] += std * np.random.default_rng(seed).standard_normal(60)
        line = fit_line(points, np.arange(60), std)
        covered += abs(line.angle) < 1.96 * line.angle_std
        knowing.append(line.angle)
        blind.append(fit_line(points, np.arange(60), np.ones(60)).angle)
    assert 0.90 <= covered / 200 <= 0.99
    assert np.std(knowing) < 0.9 * np.std(blind)


def test_correlated_neighbours_widen_the_standard_error():
    rho, covered, blind = 0.4, 0, 0
    for seed in range(300):
        rng = np.random.default_rng(seed)
        white = rng.standard_normal(121)
        # A moving sum with these weights has correlation 0.4 at lag one and none beyond.
        across = 0.2 * (white[1:] + 0.5 * white[:-1])
        points = np.column_stack([np.arange(120) * 2.0, across])
        line = fit_line(points, np.arange(120), np.ones(120), np.array([rho]))
        covered += abs(line.angle) < 1.96 * line.angle_std
        assert line.correlation > 1.5
        alone = 0.2 * np.sqrt(1.25) / np.sqrt(((points[:, 0] - points[:, 0].mean()) ** 2).sum())
        blind += abs(line.angle) < 1.96 * alone
    assert 0.90 <= covered / 300 <= 0.99
    assert blind < covered - 10


def test_correlation_that_nobody_told_of_is_seen_in_the_residuals():
    larger = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        wave = np.convolve(rng.standard_normal(140), np.ones(5) / 5, mode="valid")[:120]
        points = np.column_stack([np.arange(120) * 2.0, wave])
        larger.append(fit_line(points, np.arange(120), np.ones(120)).correlation)
    assert np.median(larger) > 2.0


def test_a_ring_has_no_ends():
    phi = 2 * np.pi * np.arange(24) / 24
    design = np.column_stack([np.ones(24), np.cos(phi), np.sin(phi)])
    values = design @ [5.0, 0.3, -0.2] + 0.05 * np.random.default_rng(0).standard_normal(24)
    slots = np.arange(24)
    near = np.array([0.3])
    ring = fit_linear(design, values, slots, np.array([5.0, 0, 0]), neighbours=near, ring=24)
    rolled = fit_linear(
        np.roll(design, 7, axis=0), np.roll(values, 7), slots, np.array([5.0, 0, 0]), neighbours=near, ring=24
    )
    np.testing.assert_allclose(rolled.covariance, ring.covariance, rtol=1e-6)
    np.testing.assert_allclose(ring.coefficients, [5.0, 0.3, -0.2], atol=0.06)


def test_profiles_that_share_no_pixel_are_independent_and_equal_ones_are_not():
    along = sample_offsets(1.5)
    ray = np.column_stack([along, np.zeros_like(along)])[:, None, :]
    rays = np.stack([ray, ray, ray + np.array([0, 1.0]), ray + np.array([0, 2.5])])
    same, near, far = neighbour_correlation(rays, 1.5)
    assert same == pytest.approx(1.0)
    assert near == pytest.approx(0.25, abs=0.01)  # B(1) / B(0) of the cubic B-spline is a quarter
    assert far == 0.0


def test_neighbour_correlation_is_that_of_sampled_noise():
    from cwmav_rig.angle.sampling import normal_slopes

    kernel = derivative_kernel(1.5)
    rng = np.random.default_rng(5)
    first, second = [], []
    for _ in range(40):
        picture = rng.standard_normal((64, 64)).astype(np.float32)
        centres = rng.uniform(20, 40, (50, 2))
        normals = np.broadcast_to([0.6, 0.8], centres.shape).copy()
        aside = centres + 1.3 * np.array([-0.8, 0.6])
        # The slope's own derivative is what moves an edge: difference of the slopes either side.
        for at, into in ((centres, first), (aside, second)):
            slopes = normal_slopes(picture, at, normals, kernel, 1, 1)
            into.extend((slopes[:, 2] - slopes[:, 0]).tolist())
    seen = np.corrcoef(first, second)[0, 1]
    along = sample_offsets(1.5)
    ray = (along[:, None] * np.array([0.6, 0.8]))[:, None, :]
    known = neighbour_correlation(np.stack([ray, ray + 1.3 * np.array([-0.8, 0.6])]), 1.5)[0]
    assert known == pytest.approx(seen, abs=0.06)


def test_noise_level_ignores_light_and_edges():
    rows, columns = np.mgrid[0:120, 0:160]
    picture = 50.0 + 0.3 * columns + 80.0 * (rows + 0.3 * columns > 90)
    noisy = (picture + 4.0 * np.random.default_rng(2).standard_normal(picture.shape)).astype(np.float32)
    assert noise_level(noisy) == pytest.approx(4.0, rel=0.08)
    assert noise_level(np.full((64, 64), 7.0, np.float32)) == pytest.approx(12**-0.5, rel=1e-3)
