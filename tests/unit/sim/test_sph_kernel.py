# SPDX-License-Identifier: Apache-2.0
"""Kernel, equation of state and the sums of one particle against what they are by definition."""

import numpy as np
import pytest
from scipy.integrate import quad

from cwmav_sim.sph.eos import Tait
from cwmav_sim.sph.gather import FAR
from cwmav_sim.sph.kernel import Kernel, ray_integral
from cwmav_sim.sph.pair import FLUID_ROWS, WORK_ROWS, pair_constants, sum_pairs


@pytest.mark.parametrize("dimensions", [2, 3])
def test_kernel_integrates_to_one_and_vanishes_at_its_edge(dimensions):
    kernel = Kernel(0.02, dimensions)
    shell = {2: lambda r: 2 * np.pi * r, 3: lambda r: 4 * np.pi * r**2}[dimensions]
    total, _ = quad(lambda r: float(kernel.value(r)) * shell(r), 0.0, 2 * kernel.h)
    assert total == pytest.approx(1.0, rel=1e-9)
    assert float(kernel.value(2.0 * kernel.h)) == 0.0


@pytest.mark.parametrize("dimensions", [2, 3])
def test_gradient_is_the_derivative_of_the_kernel(dimensions):
    kernel = Kernel(0.02, dimensions)
    r = np.linspace(0.1, 1.9, 19) * kernel.h
    step = 1e-6 * kernel.h
    difference = (kernel.value(r + step) - kernel.value(r - step)) / (2 * step)
    np.testing.assert_allclose(kernel.gradient_over_r(r) * r, difference, rtol=1e-6)


@pytest.mark.parametrize("k", [1, 2, 3, 4])
def test_ray_integrals_match_quadrature(k):
    for q in (0.0, 0.3, 1.1, 1.9):
        expected, _ = quad(lambda s: s**k * (1 - s / 2) ** 3, q, 2.0)
        assert float(ray_integral(k, q)) == pytest.approx(expected, rel=1e-10)


def test_pressure_follows_sound_speed_and_background():
    eos = Tait(1.225, 60.0, 7.0, 100.0)
    assert float(eos.pressure(np.array(1.225))) == 100.0
    rise = float(eos.pressure(np.array(1.225 * 1.001)) - eos.pressure(np.array(1.225 * 0.999)))
    assert rise / (0.002 * 1.225) == pytest.approx(60.0**2, rel=1e-4)


def _cloud(seed, count=200):
    rng = np.random.default_rng(seed)
    rows = np.zeros((FLUID_ROWS, count + 56))
    rows[0] = FAR
    rows[0:3, :count] = rng.uniform(-0.03, 0.03, (3, count))
    rows[3:6, :count] = rng.normal(0.0, 1.0, (3, count))
    rows[6, :count] = rng.normal(0.0, 0.01, count)
    rows[7, :count] = rng.normal(0.0, 30.0, count)
    rows[8, :count] = 1e-6 * rng.uniform(0.9, 1.1, count)
    return rows, count


def test_sums_of_one_particle_are_the_written_formulas():
    rows, count = _cloud(1)
    kernel = Kernel(0.02, 3)
    k = pair_constants(kernel.h, 1.225, 1.0, 1.0, 0.0, np.dtype(np.float64))
    a = tuple(rows[:8, 0])
    n, diffusion, viscosity = rows.shape[1], 0.3, 0.7
    work = np.empty((WORK_ROWS, n))
    sums = sum_pairs(a, (diffusion, viscosity), rows, rows[8], n, k, True, work)
    r = rows[0:3, 0, None] - rows[0:3, 1:count]
    v = rows[3:6, 0, None] - rows[3:6, 1:count]
    r2 = np.sum(r**2, axis=0)
    f = kernel.gradient_over_r(np.sqrt(r2))
    volume, density, pressure = rows[8, 1:count], rows[6, 1:count], rows[7, 1:count]
    eta2 = 0.01 * kernel.h**2
    mass = volume * (1.225 + density)
    divergence = np.sum(volume * f * np.sum(v * r, axis=0))
    diffused = np.sum(volume * (density - rows[6, 0]) * f * r2 / (r2 + eta2))
    pressed = np.sum(volume * (pressure + rows[7, 0]) * f * r, axis=1)
    sheared = np.sum(mass * f * r2 / ((r2 + eta2) * (2.45 + density + rows[6, 0])) * v, axis=1)
    concentration = np.sum(volume * f * r, axis=1)
    expected = [divergence - diffusion * diffused, *(pressed - viscosity * sheared), *concentration]
    np.testing.assert_allclose(np.array(sums) * kernel.slope, expected, rtol=1e-10)
