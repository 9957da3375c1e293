# SPDX-License-Identifier: Apache-2.0
"""What no choice of units, order or idle addition may change in a reliability-based optimum."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cwmav_rbdo.optimise import optimise

few = settings(max_examples=4, deadline=None)


def base(scale=1.0, shift=0.0, order=(0, 1), extra=(), seed=0):
    """Least x + y under two curved constraints of which both are active, in other units of x if asked."""
    x = f"((x - {shift!r})/{scale!r})"
    constraints = [f"{x}**2*y/20 - 1", f"({x} + y - 5)**2/30 + ({x} - y - 12)**2/120 - 1"]
    return optimise(
        f"(mx - {shift!r})/{scale!r} + my",
        [*(constraints[k] for k in order), *extra],
        {"mx": (shift, 10.0 * scale + shift), "my": (0.0, 10.0)},
        {"x": ("normal", "mx", 0.3 * scale), "y": ("normal", "my", 0.3)},
        max_true_evaluations=47,
        seed=seed,
    )


@pytest.fixture(scope="module")
def plain():
    return base()


@few
@given(scale=st.sampled_from([1e-3, 0.5, 8.0, 1000.0]), shift=st.sampled_from([-3.0, 0.0, 50.0]))
def test_units_and_origin_of_a_variable_change_nothing_else(plain, scale, shift):
    moved = base(scale=scale, shift=shift)
    assert moved.objective == pytest.approx(plain.objective, rel=2e-3)
    assert (moved.design["mx"] - shift) / scale == pytest.approx(plain.design["mx"], abs=0.02)
    assert moved.design["my"] == pytest.approx(plain.design["my"], abs=0.02)


def test_order_of_the_constraints_changes_nothing(plain):
    swapped = base(order=(1, 0))
    assert swapped.objective == pytest.approx(plain.objective, rel=2e-3)
    names = [c.name for c in plain.constraints]
    assert [c.name for c in swapped.constraints] == names[::-1]


@few
@given(level=st.floats(20.0, 1e6))
def test_a_constraint_that_never_acts_changes_nothing(plain, level):
    more = base(extra=(f"x + {level!r}",))
    assert more.objective == pytest.approx(plain.objective, rel=2e-3)
    assert more.constraints[2].band.value == 1.0
    assert np.isclose(more.design["mx"], plain.design["mx"], atol=0.02)
