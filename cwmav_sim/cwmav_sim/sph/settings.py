# SPDX-License-Identifier: Apache-2.0
"""Settings of the particle fluid: plain frozen values, declared once with unit and limits."""

from __future__ import annotations

from dataclasses import dataclass, field

from cwmav_common.settings import setting


@dataclass(frozen=True)
class Fluid:
    """The gas and its weakly compressible model."""

    density: float = setting(1.225, "density of the air at rest", unit="kg/m3", gt=0)
    viscosity: float = setting(1.48e-5, "kinematic viscosity", unit="m2/s", ge=0)
    sound_speed: float = setting(60.0, "least artificial speed of sound", unit="m/s", gt=0)
    mach_limit: float = setting(
        0.1, "highest ratio of expected speed to sound speed; raises sound_speed where needed", gt=0, le=0.5
    )
    gamma: float = setting(7.0, "exponent of the Tait equation of state", ge=1)
    background_pressure: float = setting(0.0, "pressure added everywhere against voids", unit="Pa", ge=0)
    diffusion: float = setting(0.1, "density diffusion coefficient (Fourtakas)", ge=0, le=1)
    turbulence: str = setting(
        "none",
        "none: laminar viscosity alone; sps: with the stress of eddies below the spacing",
        choices=("none", "sps"),
    )
    gravity: float = setting(
        0.0, "acceleration along -z; needs walls above and below, or along the stream a loss", unit="m/s2"
    )
    diffusion_near_wall: str = setting(
        "keep", "density diffusion of particles that see a wall", choices=("keep", "skip")
    )

    def effective_sound_speed(self, highest_speed: float) -> float:
        """Return the speed of sound [m/s] for flows up to ``highest_speed`` [m/s]."""
        return max(self.sound_speed, highest_speed / self.mach_limit)


@dataclass(frozen=True)
class Resolution:
    """Particle spacing, kernel radius and time step."""

    dp: float = setting(0.008, "initial particle spacing", unit="m", gt=0)
    h_over_dp: float = setting(1.5, "smoothing length over particle spacing", ge=1.0, le=2.5)
    cfl: float = setting(0.2, "Courant number of the time step, on the smoothing length", gt=0, le=0.6)
    precision: str = setting("single", "precision of the pair sums", choices=("single", "double"))
    jitter: float = setting(0.1, "random initial displacement over particle spacing", ge=0, le=0.3)
    seed: int = setting(1, "seed of the initial displacement", ge=0)


@dataclass(frozen=True)
class Box:
    """Periodic box of air around the hinge point (the origin); x runs with the stream, z up."""

    length: float = setting(0.48, "extent in x", unit="m", gt=0)
    width: float = setting(0.48, "extent in y of the full box", unit="m", gt=0)
    height: float = setting(0.36, "extent in z", unit="m", gt=0)
    upstream: float = setting(0.14, "distance from the upstream face to the origin", unit="m", ge=0)
    symmetric: bool = setting(True, "compute the half y > 0 with a free-slip mirror at y = 0")
    dimensions: int = setting(3, "3, or 2 for the x-z plane alone", ge=2, le=3)


@dataclass(frozen=True)
class Fringe:
    """Zone at the downstream end of the box that restores the stream and the density."""

    width: float = setting(0.10, "extent in x; 0 switches it off", unit="m", ge=0)
    rate: float = setting(400.0, "largest relaxation rate", unit="1/s", ge=0)
    around: bool = setting(False, "also along the faces across z, so that sound leaves there too")


@dataclass(frozen=True)
class Shifting:
    """Particle shifting against clumping and voids."""

    coefficient: float = setting(2.0, "strength; 0 switches it off", ge=0, le=5)
    limit: float = setting(0.05, "largest shift per step over particle spacing", gt=0, le=0.5)
    tensile: float = setting(0.2, "weight of the anti-clumping term", ge=0, le=1)


@dataclass(frozen=True)
class SheetOptions:
    """Numerics of the thin two-sided walls; lengths are over the particle spacing."""

    treatment: str = setting(
        "two-sided",
        "two-sided: each face its own air; dbc: plain dynamic boundary of one layer, for comparison",
        choices=("two-sided", "dbc"),
    )
    element_spacing: float = setting(1.0 / 3.0, "spacing of the wall quadrature", gt=0.1, le=1)
    set_back: float = setting(0.25, "inward displacement of the free edges", ge=0, le=2)
    keep_out: float = setting(0.4, "distance below which particles are eased away", ge=0, le=1)
    approach_damping: float = setting(0.0, "factor of the pressure that resists approach", ge=0, le=50)


@dataclass(frozen=True)
class FlowSettings:
    """Everything the particle fluid needs besides the stream and the wings."""

    fluid: Fluid = field(default_factory=Fluid)
    resolution: Resolution = field(default_factory=Resolution)
    box: Box = field(default_factory=Box)
    fringe: Fringe = field(default_factory=Fringe)
    shifting: Shifting = field(default_factory=Shifting)
    sheet: SheetOptions = field(default_factory=SheetOptions)
