# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from cwmav_common.errors import InputError
from cwmav_rbdo.window import WindowSettings, moving_window

LOWER, UPPER = np.array([4.0, -10.0, 0.0]), np.array([30.0, 60.0, 6.0])


def test_range_rule_gives_a_quarter_of_the_range_around_the_optimum():
    window = moving_window(WindowSettings(q=0.25), LOWER, UPPER, np.array([15.0, 25.0, 3.0]))
    assert window.upper - window.lower == pytest.approx([6.5, 17.5, 1.5])
    assert 0.5 * (window.upper + window.lower) == pytest.approx([15.0, 25.0, 3.0])


def test_sum_rule_is_eq_11_as_printed():
    window = moving_window(WindowSettings(q=0.25, rule="sum"), LOWER, UPPER, np.array([15.0, 25.0, 3.0]))
    assert window.upper - window.lower == pytest.approx([8.5, 12.5, 1.5])


def test_window_is_clipped_to_the_space_and_keeps_an_extent_at_a_corner():
    window = moving_window(WindowSettings(q=0.1), LOWER, UPPER, LOWER)
    assert np.all(window.lower == LOWER)
    assert window.upper - window.lower == pytest.approx(0.05 * (UPPER - LOWER))


def test_sum_rule_on_a_symmetric_range_is_refused_with_the_way_out():
    with pytest.raises(InputError, match="width 0 .* use rule 'range'"):
        moving_window(WindowSettings(rule="sum"), np.array([-5.0]), np.array([5.0]), np.array([0.0]))
