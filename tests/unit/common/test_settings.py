# SPDX-License-Identifier: Apache-2.0
"""Settings declared once: validation, overrides, descriptions."""

from dataclasses import dataclass, field

import pytest

from cwmav_common.errors import InputError
from cwmav_common.settings import (
    describe,
    from_mapping,
    load_yaml,
    markdown_table,
    override,
    setting,
    to_mapping,
)


@dataclass(frozen=True)
class Air:
    density: float = setting(1.225, "density of the air at rest", unit="kg/m3", gt=0, le=10)
    gamma: int = setting(7, "polytropic index", ge=1)
    wall: str = setting("sheet", "wall treatment", choices=("sheet", "dbc"))


@dataclass(frozen=True)
class Rod:
    diameter: float = setting(..., "diameter", unit="m", gt=0)


@dataclass(frozen=True)
class Case:
    spacing: float = setting(..., "particle spacing", unit="m", gt=0)
    air: Air = field(default_factory=Air)
    rods: tuple[Rod, ...] = ()
    seed: int | None = setting(None, "seed of the noise", ge=0)

    def __post_init__(self) -> None:
        if self.spacing > 1:
            raise InputError(f"spacing {self.spacing:g} m does not fit the box; allowed: at most 1 m")


def test_round_trip_keeps_every_value():
    case = from_mapping(Case, {"spacing": 0.01, "air": {"density": 1.34}, "rods": [{"diameter": 1e-3}]})
    assert case == Case(0.01, Air(density=1.34), (Rod(1e-3),))
    assert from_mapping(Case, to_mapping(case)) == case


@pytest.mark.parametrize(
    ("mapping", "expected"),
    [
        ({"spacing": -1}, "'spacing' is -1; allowed: float > 0 m"),
        ({}, "'spacing' is missing; expected float > 0 m"),
        (
            {"spacing": 0.1, "air": {"densty": 1}},
            "unknown key 'air.densty'; allowed here: density, gamma, wall",
        ),
        ({"spacing": 0.1, "colour": 1}, "unknown key 'colour'; allowed here: air, rods, seed, spacing"),
        ({"spacing": 0.1, "air": {"wall": "wood"}}, "'air.wall' is 'wood'; allowed: one of sheet, dbc"),
        ({"spacing": 0.1, "air": {"density": float("nan")}}, "'air.density' is nan"),
        ({"spacing": 0.1, "seed": -3}, "'seed' is -3; allowed: int >= 0"),
        ({"spacing": 2.0}, "does not fit the box; allowed: at most 1 m"),
    ],
)
def test_errors_name_source_key_value_and_what_is_allowed(mapping, expected):
    with pytest.raises(InputError) as caught:
        from_mapping(Case, mapping, source="case.yaml")
    assert str(caught.value).startswith("case.yaml: ")
    assert expected in str(caught.value)


def test_yaml_reads_exponents_as_numbers(tmp_path):
    path = tmp_path / "case.yaml"
    path.write_text("spacing: 1e-3\nair: {density: 2}\n")
    assert load_yaml(Case, path) == Case(1e-3, Air(density=2.0))


@pytest.mark.parametrize("text", ["a: [", "- 1\n- 2\n", "\x00"])
def test_unreadable_yaml_names_the_file(tmp_path, text):
    path = tmp_path / "broken.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match="broken.yaml"):
        load_yaml(Case, path)


def test_missing_file_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match="absent.yaml"):
        load_yaml(Case, tmp_path / "absent.yaml")


def test_override_validates_again():
    case = Case(0.01)
    assert override(case, ["air.density=1.3", "spacing=2e-3"]) == Case(2e-3, Air(density=1.3))
    with pytest.raises(InputError, match=r"--set.*'air.density' is -1"):
        override(case, ["air.density=-1"])
    with pytest.raises(InputError, match="allowed here: density, gamma, wall"):
        override(case, ["air.rho=1"])
    with pytest.raises(InputError, match="expected key=value"):
        override(case, ["air.density"])


def test_description_lists_nested_settings_with_units_and_limits():
    keys = {item.key: item for item in describe(Case)}
    assert keys["air.density"].unit == "kg/m3"
    assert keys["air.density"].allowed() == "float > 0 and <= 10 kg/m3"
    assert keys["air.wall"].choices == ("sheet", "dbc")
    assert "| `air.gamma` | `7` |" in markdown_table(Case)
