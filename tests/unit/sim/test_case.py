# SPDX-License-Identifier: Apache-2.0
"""Cases: presets, YAML, overrides, refusals and content addresses."""

import math

import pytest

from cwmav_common.errors import InputError
from cwmav_sim import case as cases
from cwmav_sim.fingerprint import significant_source, solver_fingerprint


@pytest.mark.parametrize("name", ["smoke", "coarse", "fine", "default", "paper"])
def test_every_preset_is_valid_and_knows_its_name(name):
    assert cases.preset(name).preset == name
    assert name in cases.presets()


def test_paper_preset_holds_table_2():
    flow = cases.preset("paper").flow
    assert flow.resolution.dp == 0.004
    assert flow.resolution.h_over_dp == pytest.approx(1.2 * math.sqrt(2))
    assert flow.resolution.cfl == 0.2
    assert flow.fluid.density == 1.34
    assert flow.fluid.viscosity == 1.48e-5
    assert flow.fluid.gamma == 7
    assert flow.fluid.diffusion == 0.1
    assert flow.fluid.sound_speed == pytest.approx(20 * math.sqrt(9.81 * 0.5))
    assert flow.shifting.coefficient == 0.0
    box = flow.box
    particles = box.length * box.width * box.height / flow.resolution.dp**3
    assert particles == pytest.approx(2.1e6, rel=0.01)


def test_spacings_of_the_presets():
    spacings = {name: cases.preset(name).flow.resolution.dp for name in cases.presets()}
    assert spacings == {"smoke": 0.012, "coarse": 0.008, "fine": 0.004, "default": 0.004, "paper": 0.004}


def test_unknown_preset_names_the_allowed_ones():
    with pytest.raises(InputError, match="'finest'.*smoke, coarse, fine, default, paper"):
        cases.preset("finest")


def test_yaml_round_trip_keeps_everything(tmp_path):
    case = cases.with_overrides(
        cases.preset("coarse").at(12.0, 20.0, 3.0), ["run.cycles=6", "run.cycles_max=8"]
    )
    cases.dump_case(case, tmp_path / "case.yaml")
    assert cases.load_case(tmp_path / "case.yaml") == case


def test_yaml_starts_from_the_preset_it_names(tmp_path):
    path = tmp_path / "case.yaml"
    path.write_text("preset: smoke\nflapping_frequency: 10\nrun: {cycles: 5, cycles_max: 5}\n")
    case = cases.load_case(path)
    assert case.flow.resolution.dp == 0.012
    assert (case.flapping_frequency, case.run.cycles, case.run.discard) == (10.0, 5, 1)


def test_yaml_with_an_unknown_key_is_refused(tmp_path):
    path = tmp_path / "case.yaml"
    path.write_text("preset: smoke\nflow: {resolution: {spacing: 0.01}}\n")
    with pytest.raises(InputError, match=r"case\.yaml.*flow\.resolution\.spacing"):
        cases.load_case(path)


@pytest.mark.parametrize(
    ("point", "message"),
    [
        ((3.0, 15.0, 3.5), "flapping_frequency.*3.0.*>= 4"),
        ((31.0, 15.0, 3.5), "flapping_frequency.*31.0.*<= 30"),
        ((16.0, -11.0, 3.5), "angle_of_attack_deg.*-11.0.*>= -10"),
        ((16.0, 61.0, 3.5), "angle_of_attack_deg.*61.0.*<= 60"),
        ((16.0, 15.0, -0.1), "airspeed.*-0.1.*>= 0"),
        ((16.0, 15.0, 6.1), "airspeed.*6.1.*<= 6"),
        ((float("nan"), 15.0, 3.5), "flapping_frequency.*nan"),
    ],
)
def test_points_outside_the_design_space_are_refused(point, message):
    with pytest.raises(InputError, match=message):
        cases.preset("smoke").at(*point)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("flow.resolution.dp=-0.004", "dp.*-0.004.*> 0"),
        ("flow.resolution.cfl=0.7", "cfl.*0.7.*<= 0.6"),
        ("flow.box.length=0.3", "flow.box: the wings reach x"),
        ("flow.box.height=0.2", "flow.box: the wings reach z"),
        ("flow.box.width=0.28", "flow.box: the wings reach y"),
        ("kinematics.clap_half_gap_deg=2.5", "clap_half_gap_deg is 2.5 deg.*12 mm.*3.51 deg"),
        ("run.discard=3", "run.discard is 3.*less than run.cycles"),
        ("run.cycles_max=2", "run.cycles_max is 2.*at least run.cycles"),
        ("flow.resolution.nonsense=1", "nonsense"),
        ("run.cycles", "key=value"),
    ],
)
def test_settings_that_make_no_sense_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        cases.with_overrides(cases.preset("smoke"), [change])


def test_a_step_too_long_for_a_light_film_is_refused_with_its_limit():
    light = ["wing.model=membrane", "structure.film.thickness=2e-6"]
    with pytest.raises(InputError, match=r"cfl is 0.4 with a film of 1.84 g/m2, 0.13.*at most 0.083"):
        cases.with_overrides(cases.preset("smoke"), light)
    cases.with_overrides(cases.preset("smoke"), [*light, "flow.resolution.cfl=0.08"])
    cases.with_overrides(cases.preset("smoke"), light[1:])


def test_address_of_prescribed_wings_does_not_depend_on_a_structure_they_do_not_have():
    case = cases.preset("smoke")
    assert case.address() == cases.with_overrides(case, ["structure.film.density=1000"]).address()
    flexible = cases.with_overrides(case, ["wing.model=membrane"])
    assert flexible.address() != case.address()
    assert flexible.address() != cases.with_overrides(flexible, ["structure.film.density=1000"]).address()
    assert flexible.solver != case.solver


def test_wings_stay_in_the_box_over_the_whole_design_space():
    for name in ("smoke", "coarse", "fine", "default", "paper"):
        for angle in (-10.0, 60.0):
            cases.preset(name).at(4.0, angle, 6.0)
            cases.preset(name).at(30.0, angle, 0.0)


def test_address_depends_on_settings_but_not_on_the_name():
    case = cases.preset("smoke")
    assert case.address() == cases.preset("smoke").address()
    assert case.address() != case.at(16.0, 15.0, 3.4).address()
    assert case.address() != cases.with_overrides(case, ["flow.fluid.density=1.2"]).address()
    assert case.address() == cases.with_overrides(case, ["preset=mine"]).address()


def test_address_depends_on_the_solver(monkeypatch):
    case = cases.preset("smoke")
    before = case.address()
    monkeypatch.setattr(cases, "solver_fingerprint", lambda: "another")
    assert case.address() != before


def test_fingerprint_ignores_explanations_only():
    source = '"""What."""\n\ndef f(x):\n    """Why."""\n    # because\n    return x + 1\n'
    explained = '"""What it is,\nat length."""\ndef f(x):\n    """Why not."""\n\n    return x + 1\n'
    changed = explained.replace("x + 1", "x + 2")
    assert significant_source(source) == significant_source(explained)
    assert significant_source(source) != significant_source(changed)


def test_fingerprint_is_twelve_hexadecimal_digits():
    assert len(solver_fingerprint()) == 12
    int(solver_fingerprint(), 16)
