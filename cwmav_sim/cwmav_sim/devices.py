# SPDX-License-Identifier: Apache-2.0
"""Where the air is computed: on the processor or on a graphics card."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import InputError
from cwmav_sim.solver import Solver, StepInfo
from cwmav_sim.sph.settings import FlowSettings
from cwmav_sim.sph.sheet import Motion
from cwmav_sim.sph.timers import Timers
from cwmav_sim.views import ParticleView

FloatArray = NDArray[np.float64]

DEVICES = ("cpu", "cuda")


class AirSolver(ParticleView, Protocol):
    """What a run needs of a solver, whatever it computes on; see :class:`cwmav_sim.solver.Solver`.

    Its arrays are not to be written to.
    """

    steps: int
    crossings: int
    sound_speed: float
    fringe_work: float
    wall_impulse: FloatArray
    fringe_impulse: FloatArray
    gravity_impulse: FloatArray
    timers: Timers

    def step(self) -> StepInfo:
        """Advance by one time step."""
        ...

    @property
    def particles(self) -> int:
        """Number of particles."""
        ...

    @property
    def identity(self) -> NDArray[np.int64]:
        """Numbers of the particles, in their present order, shape (n,)."""
        ...

    def set_pressure(self, pressure: FloatArray) -> None:
        """Give the particles the densities that belong to pressures [Pa] without background, shape (n,)."""
        ...

    def momentum(self) -> FloatArray:
        """Momentum of the air [kg m/s], shape (3,)."""
        ...

    def kinetic_energy(self) -> float:
        """Kinetic energy of the air [J]."""
        ...

    def pairs(self) -> int:
        """Ordered pairs of particles within the support."""
        ...

    def save(self) -> dict[str, NDArray]:
        """Return everything that is needed to go on from here, by name."""
        ...

    def restore(self, saved: dict[str, NDArray]) -> None:
        """Go to a saved state."""
        ...


def check_device(device: str) -> None:
    """Refuse a device that is not there.

    Raises
    ------
    InputError
        Says what was looked for, what is missing and what is allowed.
    """
    if device not in DEVICES:
        raise InputError(f"device '{device}' is unknown; allowed: {', '.join(DEVICES)}")
    if device == "cuda":
        from cwmav_sim.cuda.device import find_card

        card = find_card()
        if not card.usable:
            raise InputError(
                "device 'cuda' needs the package numba-cuda, an NVIDIA card with its driver and the compiler "
                f"of the kernels; missing: {card.missing}; allowed here: cpu"
            )


def card_name(device: str) -> str | None:
    """Return the name of the card that a device means; None for the processor."""
    if device != "cuda":
        return None
    from cwmav_sim.cuda.device import find_card

    return find_card().name


def make_solver(
    device: str,
    settings: FlowSettings,
    motion: Motion | None,
    airspeed: float,
    *,
    highest_speed: float | None = None,
) -> AirSolver:
    """Return a solver on a device that :func:`check_device` lets pass.

    Raises
    ------
    InputError
        For settings that the device cannot compute.
    """
    if device == "cuda":
        from cwmav_sim.cuda.solver import CudaSolver

        return CudaSolver(settings, motion, airspeed, highest_speed=highest_speed)
    return Solver(settings, motion, airspeed, highest_speed=highest_speed)
