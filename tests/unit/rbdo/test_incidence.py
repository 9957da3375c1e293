# SPDX-License-Identifier: Apache-2.0
"""The incidence offset from runs at several angles."""

import numpy as np
import pytest

from cwmav_rbdo.reproduction.incidence import offset_for


def test_the_offset_of_a_straight_line_is_found_in_any_order():
    assert offset_for([30.0, -10.0, 0.0], [0.31, -0.09, 0.01], 0.05) == pytest.approx(4.0)


def test_the_angle_nearest_to_zero_is_taken():
    angle = np.linspace(-60.0, 60.0, 61)
    lift = np.sin(np.radians(4.0 * angle))
    assert offset_for(angle, lift, 0.5) == pytest.approx(7.5, abs=0.1)


def test_nothing_is_said_without_slope_or_within_reach():
    assert offset_for([0.0, 15.0], [0.0, 0.2], 0.05) is None
    assert offset_for([0.0, 15.0, 30.0], [0.0, 0.1, 0.2], 0.3) is None
