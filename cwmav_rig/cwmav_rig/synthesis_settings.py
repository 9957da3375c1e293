# SPDX-License-Identifier: Apache-2.0
"""What a synthetic recording shall hold: the setting, its scatter, the instruments and their artefacts."""

from __future__ import annotations

from dataclasses import dataclass, field

from cwmav_common.settings import setting
from cwmav_rig.physics.drive import POWER_MODELS

RUNS = ("flapping", "wind_off", "wings_still")


@dataclass(frozen=True)
class Scatter:
    """How the controls wander about the setting. Defaults give the paper's point its standard deviations."""

    frequency_relative: float = setting(
        0.153 / 12.0, "standard deviation of the frequency per cycle, relative", ge=0, le=0.2
    )
    frequency_correlation: float = setting(
        0.8, "correlation of the frequency from one cycle to the next", gt=0, lt=1
    )
    angle_deg: float = setting(0.462, "standard deviation of the angle of attack", unit="deg", ge=0, le=20)
    angle_rocking_deg: float = setting(
        0.43, "amplitude of the body's rocking at the flapping frequency, part of angle_deg", unit="deg", ge=0
    )
    angle_memory: float = setting(
        0.2, "correlation time of the slow part of the angle of attack", unit="s", gt=0
    )
    airspeed_relative: float = setting(
        0.05 / 3.5, "standard deviation of the airspeed, relative", ge=0, le=0.5
    )
    airspeed_least: float = setting(
        0.03, "standard deviation of the airspeed is at least this", unit="m/s", ge=0
    )
    airspeed_memory: float = setting(0.3, "correlation time of the airspeed", unit="s", gt=0)


@dataclass(frozen=True)
class Artefacts:
    """What the instruments add, by name; 0 switches one off."""

    weight: float = setting(0.167, "weight of the vehicle on the sensor", unit="N", ge=0)
    force_offset: float = setting(0.05, "largest zero offset of a force axis", unit="N", ge=0)
    white_noise: float = setting(0.004, "noise of a force sample, rms", unit="N", ge=0)
    least_count: float = setting(0.00625, "resolution of the force", unit="N", ge=0)
    gain_error: float = setting(0.01, "standard deviation of the gain of the force", ge=0, le=0.5)
    bias_drift: float = setting(0.001, "random walk of the force zero", unit="N/sqrt(s)", ge=0)
    warm_up: float = setting(0.0, "zero shift that decays while the sensor warms up", unit="N", ge=0)
    thermal: float = setting(0.0005, "zero shift per kelvin of motor heating", unit="N/K", ge=0)
    resonance_frequency: float = setting(
        75.0, "first natural frequency of the mount; 0 for a rigid one", unit="Hz", ge=0, le=4000
    )
    resonance_damping: float = setting(0.02, "damping ratio of the mount", gt=0, lt=1)
    inertia: float = setting(
        0.4, "amplitude of the inertial force at 12 Hz, at F and half of it at 2 F", unit="N", ge=0
    )
    mains: float = setting(0.010, "pick-up of the mains on force", unit="N", ge=0)
    mains_frequency: float = setting(50.0, "frequency of the mains", unit="Hz", gt=0)
    pwm: float = setting(0.0, "pick-up of the motor's switching on force, aliased", unit="N", ge=0)
    pwm_frequency: float = setting(16_100.0, "switching frequency of the motor", unit="Hz", gt=0)
    misalignment_deg: float = setting(0.0, "pitch of the sensor to the body axes", unit="deg", ge=-10, le=10)
    misalignment_yaw_deg: float = setting(
        0.0, "yaw of the sensor to the body axes", unit="deg", ge=-10, le=10
    )
    clock_offset: float = setting(
        0.05, "largest offset of an instrument's clock to that of the force sensor", unit="s", ge=0, le=10
    )
    clock_skew: float = setting(50e-6, "largest relative rate error of an instrument's clock", ge=0, le=0.01)
    stamp_jitter: float = setting(20e-6, "scatter of the time stamps", unit="s", ge=0, le=0.01)
    time_jump: float = setting(
        0.0, "jump of the force sensor's clock in the middle of the run", unit="s", ge=-1, le=10
    )
    trigger_loss: float = setting(0.0, "share of trigger edges that an instrument misses", ge=0, lt=1)
    lost_blocks: float = setting(0.0, "share of force blocks lost", ge=0, lt=1)
    nan_samples: float = setting(0.0, "share of force blocks with a run of NaN", ge=0, lt=1)
    saturation: float = setting(
        0.0, "peak of a spike that overloads the sensor once in 50 cycles", unit="N", ge=0
    )
    stuck: float = setting(0.0, "share of force blocks with a stuck converter", ge=0, lt=1)
    frame_drop: float = setting(0.002, "share of camera frames dropped", ge=0, lt=1)
    frame_duplicate: float = setting(0.0, "share of camera frames duplicated", ge=0, lt=1)
    rolling_stamp: float = setting(
        0.0,
        "saw-tooth by which frame stamps lag as the read-out rolls against the clock",
        unit="s",
        ge=0,
        le=0.1,
    )
    pixel_noise_deg: float = setting(
        0.25, "noise of one camera reading, part of the scatter of the angle", unit="deg", ge=0
    )
    current_ripple: float = setting(
        0.5, "largest deviation of the power from its mean within a cycle, relative", ge=0, lt=1
    )
    commutation: float = setting(0.03, "current ripple of the commutation, relative, near 3 kHz", ge=0, lt=1)
    shunt_offset: float = setting(0.0, "common-mode offset of the current", unit="A", ge=-1, le=1)
    channel_skew: float = setting(
        0.0, "time by which the current channel lags the voltage channel", unit="s", ge=-0.01, le=0.01
    )
    blockage: float = setting(
        0.0, "relative excess of the speed at the model over that at the tunnel's sensor", ge=-0.2, le=0.2
    )
    source_resistance: float = setting(0.5, "resistance of supply and leads", unit="ohm", ge=0, le=2)
    scope_bits: int = setting(8, "resolution of the oscilloscope", ge=4, le=24)


@dataclass(frozen=True)
class Instruments:
    """Rates and ranges of the instruments."""

    force_rate: float = setting(10_000.0, "samples per second of force", unit="Hz", gt=0, le=100_000)
    power_rate: float = setting(
        10_000.0, "samples per second of voltage and current", unit="Hz", gt=0, le=1e6
    )
    camera_rate: float = setting(1000.0, "angle readings per second", unit="Hz", gt=0, le=10_000)
    wind_rate: float = setting(100.0, "airspeed readings per second", unit="Hz", gt=0, le=10_000)
    block: int = setting(100, "samples per block message", ge=1, le=10_000)
    view_rate: float = setting(
        100.0, "rate of the WrenchStamped twin for viewers; 0 for none", unit="Hz", ge=0
    )
    range_xy: float = setting(8.0, "range of the transverse force", unit="N", gt=0)
    range_z: float = setting(14.1, "range of the axial force", unit="N", gt=0)
    tare_seconds: float = setting(
        1.0, "length of the wind-off record before and after", unit="s", ge=0.1, le=60
    )


@dataclass(frozen=True)
class Synthesis:
    """Everything that determines a synthetic recording; the same values give the same bytes."""

    flapping_frequency: float = setting(12.0, "flapping frequency", unit="Hz", ge=1, le=60)
    angle_of_attack_deg: float = setting(15.0, "angle of attack", unit="deg", ge=-90, le=90)
    airspeed: float = setting(3.5, "airspeed", unit="m/s", ge=0, le=20)
    seconds: float = setting(30.0, "length of the run", unit="s", gt=0, le=7200)
    seed: int = setting(0, "seed of everything random", ge=0)
    sensor_seed: int | None = setting(
        None, "seed of gain and zero of the force sensor, to give several recordings the same one", ge=0
    )
    run: str = setting("flapping", "flapping, or still: with the wind off (a tare run) or on", choices=RUNS)
    start_time: float = setting(1_750_000_000.0, "time of the first sample since 1970", unit="s", ge=0)
    power_model: str = setting("physical", "model of the electrical power", choices=POWER_MODELS)
    air_density: float = setting(1.225, "density of the air", unit="kg/m3", gt=0)
    scatter: Scatter = field(default_factory=Scatter)
    artefacts: Artefacts = field(default_factory=Artefacts)
    instruments: Instruments = field(default_factory=Instruments)
