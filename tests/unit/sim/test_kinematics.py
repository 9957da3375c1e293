# SPDX-License-Identifier: Apache-2.0
"""The clapping law does what its settings say."""

import math

import numpy as np
import pytest

from cwmav_common.errors import InputError
from cwmav_sim.kinematics import ClappingLaw, Kinematics, peak_rate, tip_twist

FREQUENCY = 16.0


def cycle(law, count=2000, first=2):
    times = (first + np.arange(count) / count) / FREQUENCY
    return times, [law.opening(t) for t in times]


def test_opening_runs_from_the_gap_by_half_the_opening_angle():
    kinematics = Kinematics(opening_deg=75.0, clap_half_gap_deg=2.5)
    _, series = cycle(ClappingLaw(kinematics, FREQUENCY))
    angles = np.degrees([s.c[0] for s in series])
    assert angles.min() == pytest.approx(2.5, abs=1e-9)
    assert angles.max() == pytest.approx(2.5 + 37.5, abs=1e-4)
    assert int(np.argmin(angles)) == 0, "the clap is at phase zero"


@pytest.mark.parametrize("share", [0.45, 0.5, 0.54])
def test_outstroke_takes_its_share(share):
    _, series = cycle(ClappingLaw(Kinematics(outstroke_share=share), FREQUENCY))
    opening = np.array([s.derivative(1) > 0 for s in series])
    assert opening.mean() == pytest.approx(share, abs=1e-3)


def test_wings_reverse_only_at_the_ends_of_the_stroke():
    _, series = cycle(ClappingLaw(Kinematics(second_harmonic=0.06), FREQUENCY))
    rates = np.array([s.derivative(1) for s in series])[1:]
    assert np.count_nonzero(np.diff(np.sign(rates))) == 1


def test_motion_starts_from_rest_in_the_middle():
    kinematics = Kinematics()
    start = ClappingLaw(kinematics, FREQUENCY).opening(0.0)
    assert start.c[0] == pytest.approx(kinematics.clap_half_gap + kinematics.sweep / 2)
    assert start.derivative(1) == 0.0
    assert start.derivative(2) == 0.0


def test_motion_repeats_exactly_after_the_ramp():
    law = ClappingLaw(Kinematics(ramp_cycles=0.5), FREQUENCY)
    for phase in (0.0, 0.13, 0.5, 0.77):
        one, other = (law.opening((n + phase) / FREQUENCY) for n in (1, 5))
        for k in range(3):
            size = (2 * math.pi * FREQUENCY) ** k
            assert one.derivative(k) == pytest.approx(other.derivative(k), abs=1e-9 * size)


def test_peak_rate_of_a_sinusoid():
    plain = Kinematics(second_harmonic=0.0, outstroke_share=0.5)
    expected = 0.5 * plain.sweep * 2 * math.pi * FREQUENCY
    assert peak_rate(plain, FREQUENCY) == pytest.approx(expected, rel=1e-4)


def twist(kinematics, phase, airspeed=3.5):
    opening = ClappingLaw(kinematics, FREQUENCY).opening((2 + phase) / FREQUENCY)
    return tip_twist(opening, kinematics, FREQUENCY, airspeed, 0.14, 0.085).c[0]


def test_trailing_edge_lags_behind_the_stroke():
    kinematics = Kinematics()
    assert twist(kinematics, 0.26) < -0.2, "opening: the trailing edge stays near the clap plane"
    assert twist(kinematics, 0.76) > 0.2, "closing: the trailing edge stays outside"
    assert twist(kinematics, 0.0) == pytest.approx(0.0, abs=1e-9)


def test_twist_on_the_instroke_is_the_share_of_the_flow_angle():
    kinematics = Kinematics(twist_fraction=0.3, outstroke_share=0.5, second_harmonic=0.0)
    rate = 0.5 * kinematics.sweep * 2 * math.pi * FREQUENCY
    mean_tip_speed = 2 * kinematics.sweep * FREQUENCY * 0.14
    flow_angle = math.atan(0.14 * rate / math.hypot(3.5, 0.53 * mean_tip_speed))
    # Half open, the law lets 3/4 of the flow angle through.
    assert twist(kinematics, 0.75) == pytest.approx(0.75 * 0.3 * flow_angle, rel=0.01)


def test_twist_never_exceeds_its_limit_and_falls_with_airspeed():
    kinematics = Kinematics(twist_limit_deg=40.0)
    assert abs(twist(kinematics, 0.76, airspeed=0.0)) < math.radians(40.0)
    assert twist(kinematics, 0.76, airspeed=6.0) < twist(kinematics, 0.76, airspeed=0.0)


def test_no_twist_when_switched_off():
    assert twist(Kinematics(twist_fraction=0.0), 0.7) == 0.0


def test_frequency_must_be_positive():
    with pytest.raises(InputError, match="0 Hz"):
        ClappingLaw(Kinematics(), 0.0)
