# SPDX-License-Identifier: Apache-2.0
"""The run turns a solver's steps into a mean lift; the flow itself is faked here."""

import csv
import json
import math

import meshio
import numpy as np
import pytest
from PIL import Image

from cwmav_common.errors import CancelledError, InputError, WorkError
from cwmav_sim import case as cases
from cwmav_sim import devices
from cwmav_sim import run as running
from cwmav_sim.animation import animate, stored_slices
from cwmav_sim.cuda.device import Card
from cwmav_sim.export import Snapshots, read_index
from cwmav_sim.picture import FilmObserver, SliceObserver, draw, wing_cut
from support.sim_flow import StillFlow

PERIOD = 1.0 / 16.0


class FakeFlow(StillFlow):
    """Air whose forces are a known function of time, and whose particles stand on a lattice."""

    steps_per_second = 200 / PERIOD
    lift_of_panel = staticmethod(lambda t: 0.05 + 0.3 * math.sin(2 * math.pi * t / PERIOD))

    def __init__(self, flow, motion, airspeed, **options):
        super().__init__(flow, motion, airspeed, **options)
        box, step = flow.box, flow.resolution.dp
        axes = (
            np.arange(-box.upstream, box.length - box.upstream, step),
            np.arange(0.0, box.width / 2, step),
            np.arange(-box.height / 2, box.height / 2, step),
        )
        self.position = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        self.velocity = np.zeros_like(self.position)
        self.velocity[:, 0] = airspeed + 10.0 * self.position[:, 2]
        self.density = np.full(len(self.position), 1.225)
        self.pressure = np.zeros(len(self.position))
        self.particles = len(self.position)
        self.identity = np.arange(self.particles)

    def loads(self, time):
        pressure, viscous = np.zeros((2, 3)), np.zeros((2, 3))
        pressure[0, 2] = self.lift_of_panel(time)
        viscous[1, 0] = -0.004
        return pressure, viscous, np.array([0.2, 0.1])


@pytest.fixture
def fake_flow(monkeypatch):
    monkeypatch.setattr(devices, "Solver", FakeFlow)


@pytest.fixture
def case():
    four = ["run.cycles=4", "run.discard=2", "run.cycles_max=4"]
    return cases.with_overrides(cases.preset("smoke"), four)


def test_mean_lift_counts_both_halves_and_drops_the_oscillation(fake_flow, case):
    result = running.simulate(case)
    assert result.mean_lift == pytest.approx(0.1, abs=1e-4)
    assert result.mean_drag == pytest.approx(-0.008, abs=1e-6)
    assert result.mean_power == pytest.approx(0.6)
    assert result.periodic
    assert (result.cycles, result.steps) == (4, 800)
    assert len(result.cycle_lift) == 4
    assert result.address == case.address()
    assert result.half_model


def test_json_has_the_public_keys(fake_flow, case):
    content = running.simulate(case).to_json()
    assert {
        "mean_lift_n",
        "lift_std_n",
        "mean_drag_n",
        "cycles",
        "periodic",
        "dp_m",
        "particles",
        "steps",
        "wall_s",
        "particle_steps_per_s",
        "device",
        "preset",
    } <= set(content)


def test_run_goes_on_until_periodic_but_not_for_ever(monkeypatch, case):
    class Drifting(FakeFlow):
        lift_of_panel = staticmethod(lambda t: 0.05 + 0.2 * math.exp(-t / PERIOD))

    monkeypatch.setattr(devices, "Solver", Drifting)
    patient = cases.with_overrides(case, ["run.cycles_max=12"])
    result = running.simulate(patient)
    assert result.periodic
    assert 4 < result.cycles < 12
    short = running.simulate(cases.with_overrides(case, ["run.cycles_max=5", "run.periodic_within=0.0001"]))
    assert not short.periodic
    assert short.cycles == 5


def test_progress_rises_to_the_end(fake_flow, case):
    seen = []
    running.simulate(case, on_progress=seen.append)
    fractions = [p.fraction for p in seen]
    assert fractions == sorted(fractions)
    assert fractions[-1] > 0.97
    assert 100 < len(seen) <= 4 * 51
    assert {p.cycle for p in seen} == {1, 2, 3, 4}
    assert all(p.seconds_left >= 0 for p in seen)
    assert max(abs(p.lift) for p in seen) == pytest.approx(0.7, rel=0.01)


def test_cancelled_run_says_how_far_it_was(fake_flow, case):
    calls = iter(range(1000))
    with pytest.raises(CancelledError, match="cancelled after 1.50 cycles"):
        running.simulate(case, cancelled=lambda: next(calls) >= 300)


def test_undefined_flow_is_a_failure_of_work(monkeypatch, case):
    class Exploding(FakeFlow):
        lift_of_panel = staticmethod(lambda t: 0.1 if t < PERIOD else float("nan"))

    monkeypatch.setattr(devices, "Solver", Exploding)
    with pytest.raises(WorkError, match="became undefined at t = 0.0625"):
        running.simulate(case)


def test_a_run_on_a_card_says_so_and_keeps_its_address(monkeypatch, fake_flow, case):
    monkeypatch.setattr("cwmav_sim.cuda.device.find_card", lambda: Card("Some Card", ""))
    monkeypatch.setattr("cwmav_sim.cuda.solver.CudaSolver", FakeFlow)
    monkeypatch.setattr(devices, "Solver", None)
    result = running.simulate(case, device="cuda")
    assert (result.device, result.details["cost"]["card"]) == ("cuda", "Some Card")
    assert result.address == case.address()
    assert ", cuda, " in result.source()


@pytest.mark.parametrize(
    ("device", "message"), [("cuda", "missing: .*; allowed here: cpu"), ("tpu", "'tpu' is unknown")]
)
def test_missing_device_is_bad_input(fake_flow, case, monkeypatch, device, message):
    monkeypatch.setattr("cwmav_sim.cuda.device.find_card", lambda: Card("", "a card"))
    with pytest.raises(InputError, match=message):
        running.simulate(case, device=device)


def test_folder_holds_result_history_and_settings(fake_flow, case, tmp_path):
    result = running.simulate(case, out=tmp_path / "run")
    content = json.loads((tmp_path / "run" / "result.json").read_text())
    assert content["mean_lift_n"] == result.mean_lift
    assert cases.load_case(tmp_path / "run" / "config.yaml") == case
    with (tmp_path / "run" / "history.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == result.steps
    lifts = [float(row["lift_n"]) for row in rows]
    assert lifts[49] == pytest.approx(2 * FakeFlow.lift_of_panel(PERIOD / 4), rel=1e-6)
    assert float(rows[0]["lower_right_viscous_x_n"]) == -0.004


def test_folder_that_cannot_be_written_is_a_failure_of_work(fake_flow, case, tmp_path):
    (tmp_path / "run").write_text("in the way")
    with pytest.raises(WorkError, match="cannot be written"):
        running.simulate(case, out=tmp_path / "run")


def test_header_shows_every_setting(case):
    text = "\n".join(running.header(case))
    for key in (
        "flow.resolution.dp = 0.012",
        "kinematics.opening_deg = 75.0",
        "run.cycles = 4",
        case.address(),
    ):
        assert key in text


def test_snapshots_are_a_time_series_of_wings_and_particles(fake_flow, case, tmp_path):
    running.simulate(case, observers=[Snapshots(tmp_path, case, per_cycle=2)])
    wings = sorted((tmp_path / "vtk").glob("wings_*.vtu"))
    assert len(wings) == 9, "two in each of four cycles, and the end"
    index = (tmp_path / "wings.pvd").read_text()
    assert index.count("<DataSet") == 9
    mesh = meshio.read(wings[-1])
    assert mesh.cells_dict["triangle"].shape == case.motion().triangles.shape
    assert mesh.point_data["velocity"].shape == mesh.points.shape
    cloud = meshio.read(tmp_path / "vtk" / "particles_0003.vtu")
    assert set(cloud.point_data) == {"velocity", "density", "pressure"}
    assert np.all(cloud.point_data["density"] == 1.225)


def test_slice_shows_the_shear_of_the_stream_and_the_wings(fake_flow, case, tmp_path):
    observer = SliceObserver(case)
    result = running.simulate(case, observers=[observer])
    flow = observer.slice
    assert flow.time == pytest.approx(3.25 * PERIOD, abs=PERIOD / 150)
    inner = flow.vorticity[5:-5, 5:-5]
    assert np.median(inner) == pytest.approx(10.0, rel=0.1)
    assert len(flow.wings) > 10
    draw(case, result, flow, tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size > 10_000


def test_wing_cut_lies_in_the_plane_of_the_wings(case):
    motion = case.motion()
    x = motion.state(0.0).x
    lines = wing_cut(x[motion.triangles], 0.08)
    assert lines.shape[1:] == (2, 2)
    assert lines[..., 1].min() >= x[:, 2].min() - 1e-9
    assert lines[..., 1].max() <= x[:, 2].max() + 1e-9
    assert wing_cut(x[motion.triangles], 0.2).shape == (0, 2, 2)


def test_animation_from_a_run_and_from_its_snapshots(fake_flow, case, tmp_path):
    film = FilmObserver(case, frames=3)
    running.simulate(case, out=tmp_path, observers=[film, Snapshots(tmp_path, case, per_cycle=1)])
    assert [f.time / PERIOD for f in film.slices] == pytest.approx([3.0, 3.333, 3.667], abs=0.01)
    animate(case, film.slices, tmp_path / "film.gif")
    slices = list(stored_slices(tmp_path, case))
    assert len(slices) == 5
    assert np.median(slices[2].vorticity[5:-5, 5:-5]) == pytest.approx(10.0, rel=0.1)
    assert len(slices[2].wings) > 10
    animate(case, slices, tmp_path / "stored.gif", frames_per_second=5)
    with Image.open(tmp_path / "stored.gif") as image:
        assert image.n_frames == 5


@pytest.mark.parametrize(
    ("name", "message"), [("film.avi", "'.avi' is unknown; allowed: .gif"), ("a.gif", "nothing")]
)
def test_animations_that_cannot_be_made_are_refused(case, tmp_path, name, message):
    with pytest.raises(InputError, match=message):
        animate(case, [], tmp_path / name)


def test_folder_without_snapshots_cannot_be_animated(case, tmp_path):
    with pytest.raises(InputError, match="--snapshots"):
        list(stored_slices(tmp_path, case))


def test_snapshots_of_a_continued_run_replace_those_after_the_checkpoint(fake_flow, case, tmp_path):
    running.simulate(case, observers=[Snapshots(tmp_path, case, per_cycle=4)])
    again = Snapshots(tmp_path, case, per_cycle=4, resume=True)
    view = FakeFlow(case.flow, case.motion(), 3.5)
    for cycles in (2.55, 2.76):
        view.time = cycles * PERIOD
        again(view)
    times = [time / PERIOD for time, _ in read_index(tmp_path / "wings.pvd")]
    assert times == pytest.approx(
        [0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 2.25, 2.5, 2.76], abs=0.01
    )


def test_phase_averages_hold_the_parts(fake_flow, case, tmp_path):
    running.simulate(case, out=tmp_path)
    with (tmp_path / "phases.csv").open() as file:
        rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
    assert len(rows) == 64
    for row in rows:
        assert row["lift_n"] == pytest.approx(row["pressure_lift_n"] + row["viscous_lift_n"], abs=1e-6)
    quarter = rows[16]
    assert quarter["lift_n"] == pytest.approx(2 * FakeFlow.lift_of_panel(quarter["phase"] * PERIOD), abs=0.01)
    assert quarter["viscous_drag_n"] == pytest.approx(-0.008)
    assert (tmp_path / "phases.png").stat().st_size > 10_000


def test_inertia_is_that_of_film_and_rods(fake_flow, case):
    history = running.simulate(case).history
    mass = case.nodal_mass()
    assert mass.sum() == pytest.approx(2 * 2.6e-4, rel=0.15), "two panels"
    speed = [np.array([mass @ case.motion().state(t).v]) for t in history.time[[400, 500]]]
    steps = history.inertial[401:501].sum(axis=(0, 1)) / FakeFlow.steps_per_second
    np.testing.assert_allclose(steps, (speed[0] - speed[1])[0], atol=1e-12)


def test_flexible_wings_that_leave_the_box_stop_the_run(case):
    x = np.array([[0.0, 0.1, 0.0], [0.0, 0.1, 0.2]])
    with pytest.raises(
        WorkError, match=r"left the box at t = 0.01000 s: z = 0.000 .. 0.200 m; allowed: -0.156"
    ):
        cases.check_inside(case, x, 0.01)
