# SPDX-License-Identifier: Apache-2.0
"""One simulation, described completely: point of flight, wings, air, numerics and length of the run."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
import yaml

from cwmav_common.errors import InputError, WorkError
from cwmav_common.settings import from_mapping, override, read_yaml, setting, to_mapping
from cwmav_sim.coupling import CoupledWings, Coupling
from cwmav_sim.fingerprint import coupled_fingerprint, solver_fingerprint
from cwmav_sim.kinematics import Kinematics
from cwmav_sim.sph.settings import Box, FlowSettings, Fluid, Fringe, Resolution, Shifting
from cwmav_sim.sph.sheet import expected_speed
from cwmav_sim.underway import UnderwayWings
from cwmav_sim.wing.build import flexible_wings
from cwmav_sim.wing.film_mesh import even_mesh
from cwmav_sim.wing.flexible import Flexibility, plan
from cwmav_sim.wing.geometry import WingPlanform, mesh_panel
from cwmav_sim.wing.mass import panel_mass
from cwmav_sim.wing.prescribed import Attitude, ClappingWings
from cwmav_sim.wing.sheet import FloatArray

GRAVITY = 9.81
_PHASES = 24
_LIGHT = 0.6  # film mass over that of a layer of particles, from which on the exchange takes the longest step


@dataclass(frozen=True)
class Run:
    """How long to simulate and what to average."""

    cycles: int = setting(4, "flapping cycles at least", ge=1, le=200)
    discard: int = setting(2, "leading cycles left out of the means", ge=0, le=100)
    cycles_max: int = setting(4, "flapping cycles at most, run while not yet periodic", ge=1, le=400)
    periodic_within: float = setting(
        0.02, "allowed change between the last two cycle means, over the mean force", gt=0, le=0.5
    )
    flapping: bool = setting(True, "False holds the wings still in the middle of their stroke")
    start_from: str = setting(
        "", "address of the run whose last air this one starts from, wings in full motion; empty: from rest"
    )


class _Placing(TypedDict):
    spacing: float
    half: bool
    moving: bool


@dataclass(frozen=True)
class Case:
    """Everything a run depends on; equal cases give equal results.

    Angles and frequencies are in the units people type; :attr:`angle_of_attack` gives radians.
    """

    preset: str = setting("default", "name of the preset the settings started from")
    flapping_frequency: float = setting(16.0, "flapping frequency F", unit="Hz", ge=4, le=30)
    angle_of_attack_deg: float = setting(
        15.0, "angle of attack AoA, body axis to wind", unit="deg", ge=-10, le=60
    )
    airspeed: float = setting(3.5, "forward velocity U", unit="m/s", ge=0, le=6)
    kinematics: Kinematics = field(default_factory=Kinematics)
    wing: WingPlanform = field(default_factory=WingPlanform)
    structure: Flexibility = field(default_factory=Flexibility)
    coupling: Coupling = field(default_factory=Coupling)
    flow: FlowSettings = field(default_factory=FlowSettings)
    run: Run = field(default_factory=Run)

    def __post_init__(self) -> None:
        _check_cycles(self.run)
        _check_clap_gap(self)
        _check_box(self)
        _check_light_wings(self)
        _check_start(self)

    @property
    def angle_of_attack(self) -> float:
        """Angle of attack [rad]."""
        return math.radians(self.angle_of_attack_deg)

    @property
    def copies(self) -> int:
        """How often the simulated wings count: 2 in a half model."""
        return 2 if self.flow.box.symmetric else 1

    def at(self, flapping_frequency: float, angle_of_attack_deg: float, airspeed: float) -> Case:
        """Return the same case at another point of flight.

        Raises
        ------
        InputError
            When the point lies outside 4..30 Hz, -10..60 deg, 0..6 m/s.
        """
        values = to_mapping(self) | {
            "flapping_frequency": flapping_frequency,
            "angle_of_attack_deg": angle_of_attack_deg,
            "airspeed": airspeed,
        }
        return from_mapping(Case, values, "operating point")

    @property
    def flexible(self) -> bool:
        """Whether the air moves the wings."""
        return self.wing.model != "prescribed"

    @property
    def solver(self) -> str:
        """Fingerprint of the solver that would run this case."""
        return coupled_fingerprint() if self.flexible else solver_fingerprint()

    def motion(self) -> ClappingWings | CoupledWings | UnderwayWings:
        """Return the wings of this case at the start of the run."""
        if not self.flexible:
            return UnderwayWings(self.prescribed()) if self.run.start_from else self.prescribed()
        layout = plan(self.structure, self.wing, self.kinematics, self._attitude, **self._placing)
        return CoupledWings(flexible_wings(layout), self.coupling, 1.0 / self.flapping_frequency)

    def prescribed(self) -> ClappingWings:
        """Return wings that follow the prescribed law, whatever the model of this case."""
        return ClappingWings(self.wing, self.kinematics, self._attitude, **self._placing)

    def nodal_mass(self) -> FloatArray:
        """Return the mass of film and rods at every node of the wings [kg], shape (n,)."""
        spacing = self._placing["spacing"]
        mesh = even_mesh(self.wing, spacing) if self.flexible else mesh_panel(self.wing, spacing)
        panels = 2 if self.flow.box.symmetric else 4
        return np.tile(panel_mass(self.structure, self.wing, mesh, spacing), panels)

    def highest_speed(self) -> float:
        """Return the highest speed of stream and prescribed wings [m/s], which sets the speed of sound."""
        return expected_speed(self.prescribed(), self.airspeed)

    @property
    def _attitude(self) -> Attitude:
        return Attitude(self.flapping_frequency, self.angle_of_attack, self.airspeed)

    @property
    def _placing(self) -> _Placing:
        return {
            "spacing": self.flow.resolution.dp / self.wing.nodes_per_spacing,
            "half": self.flow.box.symmetric,
            "moving": self.run.flapping,
        }

    def address(self, solver: str | None = None) -> str:
        """Return the content address: a hash of all settings and of the solver that would run them.

        The preset's name is left out, since it changes nothing that is not in the settings, and so are the
        settings of a structure that prescribed wings do not have, and a start from rest. ``solver`` is the
        fingerprint of another solver; by default it is that of this one.
        """
        content = to_mapping(self)
        del content["preset"]
        if not self.flexible:
            del content["structure"], content["coupling"], content["wing"]["model"]
        if not self.run.start_from:
            del content["run"]["start_from"]
        text = json.dumps([solver or self.solver, content], sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:32]


def presets() -> tuple[str, ...]:
    """Return the names of the presets."""
    return tuple(_PRESETS)


def preset(name: str) -> Case:
    """Return a preset at its default operating point.

    ``smoke`` (12 mm) and ``coarse`` (8 mm) are half models for plain computers, ``fine`` (4 mm, as in the
    paper) the same for a graphics card; ``default`` (4 mm) spares nothing, ``paper`` holds the values of the
    paper's Table 2.

    Raises
    ------
    InputError
        For a name that is not a preset.
    """
    if name not in _PRESETS:
        raise InputError(f"preset '{name}' is unknown; allowed: {', '.join(_PRESETS)}")
    return replace(_PRESETS[name], preset=name)


def load_case(path: str | Path) -> Case:
    """Read a case from a YAML file; keys that are absent come from the preset it names."""
    return from_dict(read_yaml(path), source=str(path))


def from_dict(values: Mapping[str, Any], source: str = "case") -> Case:
    """Build a case from nested plain values over the preset named in them."""
    base = preset(str(values.get("preset", "default")))
    return from_mapping(Case, _merged(to_mapping(base), values), source)


def dump_case(case: Case, path: str | Path) -> None:
    """Write every setting of a case as YAML."""
    Path(path).write_text(yaml.safe_dump(to_mapping(case), sort_keys=False), encoding="utf-8")


def with_overrides(case: Case, assignments: Iterable[str]) -> Case:
    """Apply ``key=value`` assignments such as ``flow.resolution.dp=0.006``."""
    return override(case, assignments)


def _merged(base: dict[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Overlay nested values on a base; unknown keys are kept so that validation names them."""
    out = dict(base)
    for key, value in values.items():
        nested = isinstance(out.get(key), dict) and isinstance(value, Mapping)
        out[key] = _merged(out[key], value) if nested else value
    return out


def paper_sound_speed(depth: float) -> float:
    """Return the artificial speed of sound of the paper's Table 2, 20 sqrt(g h_d) [m/s]."""
    return 20.0 * math.sqrt(GRAVITY * depth)


def clap_gap(case: Case) -> float:
    """Return the distance between the leading edges at 0.7 of the wing length at the clap [m]."""
    return 1.4 * case.wing.length * math.sin(case.kinematics.clap_half_gap)


def swept_extent(case: Case) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and highest coordinates the wings reach in a cycle [m], shape (3,) each."""
    motion = case.prescribed()
    period = 1.0 / case.flapping_frequency
    start = case.kinematics.ramp_cycles * period
    states = [motion.state(start + k * period / _PHASES).x for k in range(_PHASES)]
    return np.min([x.min(axis=0) for x in states], axis=0), np.max([x.max(axis=0) for x in states], axis=0)


def _check_cycles(run: Run) -> None:
    if run.discard >= run.cycles:
        raise InputError(
            f"run.discard is {run.discard}; allowed: less than run.cycles, which is {run.cycles}"
        )
    if run.cycles_max < run.cycles:
        raise InputError(
            f"run.cycles_max is {run.cycles_max}; allowed: at least run.cycles, which is {run.cycles}"
        )


def _check_clap_gap(case: Case) -> None:
    dp, gap = case.flow.resolution.dp, clap_gap(case)
    if case.run.flapping and gap < dp:
        least = math.degrees(math.asin(min(1.0, dp / (1.4 * case.wing.length))))
        raise InputError(
            f"kinematics.clap_half_gap_deg is {case.kinematics.clap_half_gap_deg:g} deg, a gap of "
            f"{1e3 * gap:.1f} mm at 70 % span; allowed: at least one particle spacing "
            f"({1e3 * dp:g} mm), that is {least:.2f} deg"
        )


def _check_box(case: Case) -> None:
    box, margin = case.flow.box, 2.0 * case.flow.resolution.dp
    low, high = swept_extent(case)
    side = 0.5 * box.width - margin
    limits_low = np.array([-box.upstream + margin, -side, -0.5 * box.height + margin])
    end = box.length - box.upstream - case.flow.fringe.width
    limits_high = np.array([end - margin, side, 0.5 * box.height - margin])
    for axis, name in enumerate("xyz"):
        if low[axis] < limits_low[axis] or high[axis] > limits_high[axis]:
            raise InputError(
                f"flow.box: the wings reach {name} = {low[axis]:.3f} .. {high[axis]:.3f} m; allowed (two "
                f"spacings clear of faces and fringe): {limits_low[axis]:.3f} .. {limits_high[axis]:.3f} m"
            )


def check_inside(case: Case, x: FloatArray, time: float) -> None:
    """Stop a run whose flexible wings have left the box.

    Raises
    ------
    WorkError
        Names the place and the limits.
    """
    box = case.flow.box
    low = np.array([-box.upstream, 0.0 if box.symmetric else -0.5 * box.width, -0.5 * box.height])
    high = np.array([box.length - box.upstream, 0.5 * box.width, 0.5 * box.height])
    for axis, name in enumerate("xyz"):
        least, most = float(x[:, axis].min()), float(x[:, axis].max())
        if not (low[axis] <= least and most <= high[axis]):
            raise WorkError(
                f"the wings left the box at t = {time:.5f} s: {name} = {least:.3f} .. {most:.3f} m; allowed: "
                f"{low[axis]:.3f} .. {high[axis]:.3f} m; make the box larger or the wings stiffer"
            )


def _check_light_wings(case: Case) -> None:
    """Refuse steps with which a film, so much lighter than a layer of particles, would be thrown away."""
    if not case.flexible:
        return
    film, resolution = case.structure.film, case.flow.resolution
    film_mass = film.density * film.thickness
    share = film_mass / (case.flow.fluid.density * resolution.dp)
    limit = 0.4 * min(1.0, share / _LIGHT)
    if resolution.cfl > limit:
        raise InputError(
            f"flow.resolution.cfl is {resolution.cfl:g} with a film of {1e3 * film_mass:.3g} g/m2, "
            f"{share:.2f} of the air in one particle spacing; allowed: at most {limit:.3f}"
        )


def _check_start(case: Case) -> None:
    start = case.run.start_from
    if not start:
        return
    if len(start) != 32 or set(start) - set("0123456789abcdef"):
        raise InputError(f"run.start_from is '{start}'; allowed: the address of a run, 32 hexadecimal digits")
    if case.flexible or not case.run.flapping or case.flow.sheet.treatment == "dbc":
        raise InputError("run.start_from is set; allowed: only for flapping prescribed wings with two sides")


def _flow(dp: float, **changes: Any) -> FlowSettings:
    return replace(FlowSettings(resolution=Resolution(dp=dp)), **changes)


def _paper() -> Case:
    # The fluid depth h_d is not stated; a box of half a metre holds the 2.1 million particles of the paper.
    sound = paper_sound_speed(0.5)
    fluid = Fluid(
        density=1.34,
        viscosity=1.48e-5,
        sound_speed=sound,
        mach_limit=0.5,
        gamma=7.0,
        diffusion=0.1,
        diffusion_near_wall="skip",
    )
    box = Box(length=0.512, width=0.512, height=0.512, upstream=0.15, symmetric=False)
    flow = _flow(0.004, fluid=fluid, box=box, shifting=Shifting(coefficient=0.0))
    flow = replace(flow, resolution=replace(flow.resolution, jitter=0.0, h_over_dp=1.2 * math.sqrt(2.0)))
    return Case(flow=flow)


def _coarse(dp: float, clap_half_gap_deg: float, run: Run, box: Box) -> Case:
    # Ten times the stroke speed of the wing tips is about six times the highest speed of any wing node, which
    # a quickly turning trailing edge reaches; the cheap presets stop there and take a longer step.
    fluid = Fluid(sound_speed=30.0, mach_limit=0.16)
    flow = FlowSettings(fluid=fluid, resolution=Resolution(dp=dp, cfl=0.4), box=box, fringe=_OPEN)
    return Case(kinematics=Kinematics(clap_half_gap_deg=clap_half_gap_deg), flow=flow, run=run)


# The air that the wings throw down must not come back through the faces across z (docs/decisions/0010).
_OPEN = Fringe(around=True)

# As tight around the swept volume as two spacings of 12 mm at every angle of attack allow.
_SMALL_BOX = Box(length=0.432, width=0.408, height=0.312, upstream=0.132)

# Gaps between the wings below two spacings are not resolved (the particles there act as a cushion), so the
# coarse presets clap with a wider gap: two spacings at 70 % span, as 2.5 deg gives at 4 mm.
_PRESETS: dict[str, Case] = {
    "smoke": _coarse(0.012, 7.0, Run(cycles=3, discard=1, cycles_max=3), _SMALL_BOX),
    "coarse": _coarse(0.008, 4.7, Run(cycles=4, discard=2, cycles_max=4), _SMALL_BOX),
    "fine": _coarse(0.004, 2.5, Run(cycles=3, discard=1, cycles_max=3), _SMALL_BOX),
    "default": Case(flow=_flow(0.004, fringe=_OPEN)),
    "paper": _paper(),
}
