# SPDX-License-Identifier: Apache-2.0
"""The wing structure alone against published and exact answers; every case keeps its 2 % bar."""

import dataclasses

import pytest

from cwmav_sim.verification.structure_cases import structure_cases
from cwmav_sim.verification.structure_flag import FlagSwinging
from cwmav_sim.verification.structure_rod import LargeDeflection, elastica

CASES = {case.name: case for case in structure_cases()}


@pytest.mark.parametrize("name", CASES)
def test_case_passes(name):
    checks = CASES[name].run()
    assert checks
    assert [c.quantity for c in checks if not c.passed] == []


def test_elastica_agrees_with_published_table():
    """Values of Bisshopp & Drucker's solution as tabulated by Mattiasson (1981)."""
    for load, drop, short in ((1.0, 0.30172, 0.05643), (2.0, 0.49346, 0.16064), (10.0, 0.81061, 0.55500)):
        assert elastica(load) == pytest.approx((drop, short), abs=1e-5)


def test_rod_converges_with_second_order():
    errors = []
    for elements in (5, 10, 20):
        case = dataclasses.replace(LargeDeflection(), elements=elements, loads=(2.0,))
        errors.append(max(abs(c.error_percent) for c in case.run()))
    assert errors[0] / errors[1] > 3.0
    assert errors[1] / errors[2] > 3.0


def test_a_wrong_stiffness_fails_the_bar(monkeypatch):
    monkeypatch.setattr("cwmav_sim.verification.structure_flag.MODULUS", 1.5e6)
    assert not all(c.passed for c in FlagSwinging(duration=2.2).run())
