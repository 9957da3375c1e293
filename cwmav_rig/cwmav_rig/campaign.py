# SPDX-License-Identifier: Apache-2.0
"""A campaign of short synthetic recordings over the design space, for the power surrogate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from cwmav_common.settings import setting
from cwmav_rig.physics.drive import POWER_MODELS
from cwmav_rig.synthesis_settings import Artefacts, Instruments, Synthesis
from cwmav_rig.synthesise import synthesise

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Campaign:
    """Which operating points are recorded, and how."""

    points: int = setting(32, "operating points inside, besides the corners and edges", ge=0, le=10_000)
    frequency_low: float = setting(4.0, "lowest flapping frequency", unit="Hz", gt=1)
    frequency_high: float = setting(30.0, "highest flapping frequency", unit="Hz", gt=1, le=40)
    angle_low_deg: float = setting(-10.0, "lowest angle of attack", unit="deg", ge=-90)
    angle_high_deg: float = setting(60.0, "highest angle of attack", unit="deg", le=90)
    airspeed_low: float = setting(0.0, "lowest airspeed", unit="m/s", ge=0)
    airspeed_high: float = setting(6.0, "highest airspeed", unit="m/s", le=20)
    beyond: float = setting(0.04, "share of each span by which the corners lie outside", ge=0, le=0.2)
    seconds: float = setting(2.0, "shortest length of a recording", unit="s", gt=0.5)
    seed: int = setting(0, "seed of the points and of every recording", ge=0)
    power_model: str = setting("physical", "model of the electrical power", choices=POWER_MODELS)
    artefacts: Artefacts = field(default_factory=Artefacts)


def design(campaign: Campaign) -> Array:
    """Give the operating points, (n, 3): F [Hz], AoA [deg], U [m/s].

    Corners and edge middles in F, a little outside of the box so that the box lies inside of the measured
    region, then a Latin hypercube.
    """
    low = np.array([campaign.frequency_low, campaign.angle_low_deg, campaign.airspeed_low])
    high = np.array([campaign.frequency_high, campaign.angle_high_deg, campaign.airspeed_high])
    margin = campaign.beyond * (high - low)
    ends = np.stack([low - margin, high + margin])
    ends[:, 0] = np.maximum(ends[:, 0], 3.2)  # slower beats are not found by the analysis
    ends[:, 2] = np.maximum(ends[:, 2], 0.0)
    frequencies = np.linspace(ends[0, 0], ends[1, 0], 4)
    outer = np.array(list(product(frequencies, ends[:, 1], ends[:, 2])))
    if not campaign.points:
        return outer
    sampler = qmc.LatinHypercube(3, rng=np.random.default_rng(campaign.seed))
    return np.vstack([outer, qmc.scale(sampler.random(campaign.points), low, high)])


def record(
    folder: str | Path, campaign: Campaign | None = None, on_recorded: Callable[[Path], None] | None = None
) -> list[Path]:
    """Write one recording per operating point into `folder`; recordings that are there already are left.

    Raises
    ------
    InputError
        The folder cannot be written to.
    """
    campaign = campaign or Campaign()
    folder = Path(folder)
    paths = []
    for k, (frequency, angle, airspeed) in enumerate(design(campaign).tolist()):
        name = f"point_{k:03d}_F{frequency:.1f}_A{angle:.1f}_U{airspeed:.2f}.mcap"
        path = folder / name
        paths.append(path)
        if not path.exists():
            partial = path.with_suffix(".part.mcap")
            synthesise(partial, _settings(campaign, k, frequency, angle, airspeed))
            partial.rename(path)
        if on_recorded is not None:
            on_recorded(path)
    return paths


def _settings(campaign: Campaign, k: int, frequency: float, angle: float, airspeed: float) -> Synthesis:
    # Power and cycle frequency need neither 10 kHz of force nor every camera frame.
    instruments = Instruments(
        force_rate=2000.0, power_rate=5000.0, camera_rate=100.0, wind_rate=50.0, block=200, view_rate=50.0,
        tare_seconds=0.2,
    )  # fmt: skip
    return Synthesis(
        flapping_frequency=frequency,
        angle_of_attack_deg=angle,
        airspeed=airspeed,
        seconds=max(campaign.seconds, 24.0 / frequency),
        seed=campaign.seed * 100_003 + k,
        power_model=campaign.power_model,
        artefacts=replace(campaign.artefacts),
        instruments=instruments,
    )
