# SPDX-License-Identifier: Apache-2.0
"""The surrogate of electrical power between operating points."""

import numpy as np
import pytest

from cwmav_common.errors import InputError
from cwmav_rig.campaign import Campaign, design, record
from cwmav_rig.physics.aero import Point
from cwmav_rig.physics.drive import electrical_power
from cwmav_rig.power_model import OperatingPoint, PowerModel, find_recordings, operating_point


def points(n=60, seed=0, noise=0.0, fixed_airspeed=None):
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(n):
        f, a = rng.uniform(4, 30), rng.uniform(-0.17, 1.05)
        u = rng.uniform(0, 6) if fixed_airspeed is None else fixed_airspeed + rng.normal(0, 0.01)
        power = 0.3 + 0.05 * f + 1e-4 * f**3 * (1 + 0.3 * a) + 0.02 * u
        made.append(OperatingPoint(f, a, u, power * (1 + noise * rng.standard_normal()), noise * power))
    return made


def law(f, a, u):
    return 0.3 + 0.05 * f + 1e-4 * f**3 * (1 + 0.3 * a) + 0.02 * u


def test_prediction_between_points_with_an_honest_uncertainty():
    model = PowerModel(points(50, noise=0.01))
    rng = np.random.default_rng(9)
    errors, scaled = [], []
    for _ in range(60):
        x = rng.uniform(6, 28), rng.uniform(-0.1, 0.9), rng.uniform(0.5, 5.5)
        answer = model.predict(*x)
        errors.append(answer.power / law(*x) - 1)
        scaled.append((answer.power - law(*x)) / answer.power_std)
    assert np.sqrt(np.mean(np.square(errors))) < 0.02
    assert 0.4 < np.sqrt(np.mean(np.square(scaled))) < 1.6


def test_the_uncertainty_grows_away_from_the_points_and_inside_says_so():
    model = PowerModel(points(30))
    near, far = model.predict(15.0, 0.4, 3.0), model.predict(60.0, 0.4, 3.0)
    assert near.inside
    assert not far.inside
    assert "outside of the measured region" in far.source
    assert far.power_std > 5 * near.power_std
    assert not model.predict(15.0, 2.0, 3.0).inside
    assert not model.predict(15.0, 0.4, 9.0).inside


def test_points_in_a_plane_have_an_inside():
    model = PowerModel(points(25, fixed_airspeed=3.0))
    assert model.predict(15.0, 0.4, 3.0).inside
    assert not model.predict(15.0, 0.4, 4.0).inside
    assert not model.predict(40.0, 0.4, 3.0).inside


def test_points_on_a_line_have_an_inside():
    line = [OperatingPoint(f, 0.2, 3.0, law(f, 0.2, 3.0), 0.01) for f in (8.0, 10.0, 12.0, 16.0, 20.0)]
    model = PowerModel(line)
    assert model.predict(11.0, 0.2, 3.0).inside
    assert model.predict(11.0, 0.2, 3.0).power == pytest.approx(law(11.0, 0.2, 3.0), rel=0.02)
    assert not model.predict(25.0, 0.2, 3.0).inside


def test_saved_and_loaded_models_answer_alike(tmp_path):
    model = PowerModel(points(30, noise=0.01))
    model.save(tmp_path / "model.json")
    assert PowerModel.load(tmp_path / "model.json").predict(12.0, 0.3, 3.0) == model.predict(12.0, 0.3, 3.0)


def test_leave_one_out_agrees_with_leaving_one_out():
    made = points(25, noise=0.02)
    model = PowerModel(made)
    closed = model.leave_one_out()
    assert len(closed) == 25
    typical = np.sqrt(np.mean(closed**2))
    for k in (3, 11):
        answer = PowerModel(made[:k] + made[k + 1 :]).predict(
            made[k].flapping_frequency, made[k].angle_of_attack, made[k].airspeed
        )
        # The kernel is fitted anew here, so only the size agrees.
        assert answer.power / made[k].power - 1 == pytest.approx(closed[k], abs=typical)


@pytest.mark.parametrize("name", ["physical", "paper_law"])
def test_bundled_models_follow_their_law(name):
    model = PowerModel.bundled(name)
    rng = np.random.default_rng(0)
    errors = []
    for _ in range(40):
        f, a, u = rng.uniform(4, 30), rng.uniform(-0.17, 1.04), rng.uniform(0, 6)
        answer = model.predict(f, a, u)
        assert answer.inside
        assert "synthetic" in answer.source
        assert name in answer.source
        errors.append(answer.power / electrical_power(name, Point(f, a, u)) - 1)
    assert np.sqrt(np.mean(np.square(errors))) < {"physical": 0.002, "paper_law": 0.05}[name]


def test_a_campaign_of_recordings_becomes_a_model(tmp_path):
    campaign = Campaign(points=2, seconds=1.0, frequency_low=10.0, airspeed_low=2.0)
    assert design(campaign).shape == (18, 3)
    seen = []
    record(tmp_path, campaign, seen.append)
    assert len(seen) == 18
    stamps = [path.stat().st_mtime_ns for path in seen]
    assert [p.stat().st_mtime_ns for p in record(tmp_path, campaign)] == stamps  # nothing is made twice
    model = PowerModel.from_recordings([tmp_path])
    assert len(model.points) == 18
    answer = model.predict(16.0, 0.3, 4.0)
    assert answer.inside
    assert answer.power == pytest.approx(electrical_power("physical", Point(16.0, 0.3, 4.0)), rel=0.02)
    assert answer.source == "power surrogate of 18 recordings (synthetic, physical power)"


def test_what_is_wrong_is_named(tmp_path, small_bag):
    with pytest.raises(InputError, match="2 operating points; at least 4"):
        PowerModel(points(2))
    with pytest.raises(InputError, match="must be positive"):
        PowerModel([*points(5), OperatingPoint(1.0, 0.1, 1.0, -2.0, 0.1, "bad")])
    with pytest.raises(InputError, match="no such recording"):
        find_recordings([tmp_path / "none"])
    with pytest.raises(InputError, match="holds no recording"):
        find_recordings([tmp_path])
    (tmp_path / "x.json").write_text("{}")
    with pytest.raises(InputError, match=r"x\.json: is no cwmav power model"):
        PowerModel.load(tmp_path / "x.json")
    with pytest.raises(InputError, match="must be finite"):
        PowerModel(points(8)).predict(float("nan"), 0.0, 1.0)
    with pytest.raises(InputError, match="allowed: physical, paper_law"):
        PowerModel.bundled("other")
    from cwmav_rig.analysis import analyse
    from cwmav_rig.topic_map import from_plain

    bare = from_plain({"force": {"topic": "/rig/wrench_block"}, "tare": "none"}, "map")
    with pytest.raises(InputError, match="no angle of attack and no wind and no power"):
        operating_point(analyse(small_bag, bare))
