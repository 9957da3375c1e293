# SPDX-License-Identifier: Apache-2.0
"""What is said where there is no graphics card, and what the card does not compute."""

from dataclasses import replace

import pytest

from cwmav_common.errors import InputError
from cwmav_sim import case as cases
from cwmav_sim import devices
from cwmav_sim.balance import cost
from cwmav_sim.benchmark import CardFigures
from cwmav_sim.cuda import device
from cwmav_sim.cuda.interaction import refuse_unknown
from cwmav_sim.solver import Solver
from support.sim_flow import StillFlow


@pytest.fixture(autouse=True)
def forgetful():
    device.find_card.cache_clear()
    yield
    device.find_card.cache_clear()


def test_the_package_is_looked_for_first(monkeypatch):
    monkeypatch.setattr(device, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"missing: the package numba-cuda \(pip install 'cwmav\[cuda\]'\)"):
        devices.check_device("cuda")


def test_what_the_driver_says_is_passed_on(monkeypatch):
    pytest.importorskip("numba_cuda")
    from numba import cuda

    def none():
        raise RuntimeError("Error at init:\n\nno card is plugged in.\n:")

    monkeypatch.setattr(cuda, "get_current_device", none)
    message = r"needs .* missing: a card with its driver \(no card is plugged in\); allowed here: cpu"
    with pytest.raises(InputError, match=message):
        devices.check_device("cuda")


def test_a_card_without_the_compiler_is_not_usable(monkeypatch):
    pytest.importorskip("numba_cuda")
    from numba import cuda

    def fail():
        raise RuntimeError("libnvvm is not there")

    monkeypatch.setattr(cuda, "get_current_device", lambda: type("Found", (), {"name": b"Some Card"}))
    monkeypatch.setattr(device, "_try_kernel", fail)
    assert "compiler of the kernels" in device.find_card().missing
    monkeypatch.setattr(device, "_try_kernel", lambda: None)
    device.find_card.cache_clear()
    assert device.find_card() == device.Card("Some Card", "")
    assert devices.card_name("cuda") == "Some Card"


def test_an_unknown_device_is_bad_input():
    with pytest.raises(InputError, match="device 'abacus' is unknown; allowed: cpu, cuda"):
        devices.check_device("abacus")


def test_the_processor_needs_no_card():
    devices.check_device("cpu")
    assert devices.card_name("cpu") is None
    case = cases.preset("smoke")
    assert isinstance(devices.make_solver("cpu", case.flow, None, 1.0), Solver)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("flow.sheet.treatment=dbc", "flow.sheet.treatment = dbc is computed on the CPU only"),
        ("flow.fluid.turbulence=sps", "flow.fluid.turbulence = sps is computed on the CPU only"),
    ],
)
def test_what_only_the_processor_computes_is_refused(change, message):
    case = cases.with_overrides(cases.preset("smoke"), [change])
    with pytest.raises(InputError, match=message):
        refuse_unknown(case.flow, case.motion())
    refuse_unknown(replace(case.flow, fluid=cases.preset("smoke").flow.fluid), None)


def test_the_cost_of_a_run_names_the_card():
    flow = StillFlow(None, None, 0.0)
    assert "card" not in cost(flow, 10, 1.0)
    assert cost(flow, 10, 1.0, "Some Card")["card"] == "Some Card"


def test_figures_of_a_card_stand_beside_the_bars():
    figures = CardFigures("Some Card", 2_000_000, 300, 10.0, 164.0, {"card": 0.9})
    content = figures.to_json()
    assert content["particle_steps_per_s"] == 60e6
    assert (content["device"], content["card"]) == ("cuda", "Some Card")
    assert content["pair_interactions_per_s"] == 2 * 164 * 60e6
    text = "1.00 of the 60 million wanted, 0.40 of the 150 million aimed at"
    assert any(text in line for line in figures.lines())
