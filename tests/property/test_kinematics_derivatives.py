# SPDX-License-Identifier: Apache-2.0
"""Rates and accelerations are the derivatives of the positions, for any allowed setting."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cwmav_sim.kinematics import ClappingLaw, Kinematics
from cwmav_sim.taylor import Taylor, bounded, power, sin_cos
from cwmav_sim.wing.geometry import WingPlanform
from cwmav_sim.wing.prescribed import Attitude, ClappingWings

laws = st.builds(
    Kinematics,
    opening_deg=st.floats(20.0, 110.0),
    dihedral_deg=st.floats(-20.0, 20.0),
    clap_half_gap_deg=st.floats(1.0, 12.0),
    second_harmonic=st.floats(-0.15, 0.15),
    outstroke_share=st.floats(0.45, 0.55),
    ramp_cycles=st.floats(0.3, 1.5),
    twist_fraction=st.floats(0.0, 1.2),
)


@given(law=laws, frequency=st.floats(4.0, 30.0), phase=st.floats(0.05, 4.0))
@settings(max_examples=60, deadline=None)
def test_opening_derivatives_match_finite_differences(law, frequency, phase):
    motion = ClappingLaw(law, frequency)
    t, step = phase / frequency, 1e-4 / frequency
    here = motion.opening(t)
    for k in range(3):
        before = motion.opening(t - step).derivative(k)
        after = motion.opening(t + step).derivative(k)
        scale = (2 * math.pi * frequency) ** (k + 1) * math.radians(law.opening_deg)
        # The fourth derivative jumps where the ramp ends; the scheme is of first order there.
        tolerance = 1e-4 if k < 2 else 2e-2
        assert (after - before) / (2 * step) == pytest.approx(here.derivative(k + 1), abs=tolerance * scale)


@given(
    law=laws,
    frequency=st.floats(4.0, 30.0),
    aoa=st.floats(math.radians(-10), math.radians(60)),
    airspeed=st.floats(0.0, 6.0),
    phase=st.floats(0.05, 3.0),
)
@settings(max_examples=40, deadline=None)
def test_node_velocity_and_acceleration_match_finite_differences(law, frequency, aoa, airspeed, phase):
    wings = ClappingWings(WingPlanform(), law, Attitude(frequency, aoa, airspeed), spacing=0.03, half=False)
    t, step = phase / frequency, 2e-5 / frequency
    before, here, after = wings.state(t - step), wings.state(t), wings.state(t + step)
    omega = 2 * math.pi * frequency
    velocity = (after.x - before.x) / (2 * step)
    acceleration = (after.v - before.v) / (2 * step)
    np.testing.assert_allclose(velocity, here.v, atol=1e-3 * 0.14 * omega)
    np.testing.assert_allclose(acceleration, here.a, atol=2e-2 * 0.14 * omega**2)


@given(value=st.floats(-3.0, 3.0), slope=st.floats(-2.0, 2.0), curve=st.floats(-2.0, 2.0))
@settings(max_examples=60, deadline=None)
def test_series_of_functions_match_finite_differences(value, slope, curve):
    def argument(t):
        time = Taylor.time(t, 3)
        return value + slope * time + curve * (time * time)

    functions = {
        "sin": lambda u: sin_cos(u)[0],
        "cos": lambda u: sin_cos(u)[1],
        "power": lambda u: power(u * u + 1.0, -0.25),
        "bounded": lambda u: bounded(u, 0.7),
        "quotient": lambda u: u / (u * u + 2.0),
    }
    step = 1e-5
    for name, function in functions.items():
        here, before, after = (function(argument(t)) for t in (0.1, 0.1 - step, 0.1 + step))
        for k in range(3):
            slope_found = (after.derivative(k) - before.derivative(k)) / (2 * step)
            size = 1.0 + abs(here.derivative(k + 1))
            assert slope_found == pytest.approx(here.derivative(k + 1), abs=1e-4 * size), (name, k)
