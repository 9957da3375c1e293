# SPDX-License-Identifier: Apache-2.0
"""How fast the solver is on this machine."""

from __future__ import annotations

import math
import time
import tracemalloc
from dataclasses import dataclass, replace
from typing import Any

import numba

from cwmav_sim import case as cases
from cwmav_sim.case import Case
from cwmav_sim.devices import card_name, make_solver
from cwmav_sim.machine import MachineLimits, measure_limits
from cwmav_sim.solver import Solver
from cwmav_sim.sph.settings import Box

_PASSES = 2  # force evaluations of a predictor-corrector step
_LEAST, _AIM = 60e6, 150e6  # particle-steps per second on one data-centre card, 2.1 million particles
_PAIR_OPERATIONS = 52  # additions and multiplications of a pair, root and division counted once each


@dataclass(frozen=True)
class Figures:
    """Speed of flapping wings in a half model.

    Attributes
    ----------
    particles, steps : int
        Size and length of the measurement.
    seconds, cpu_seconds : float
        Wall time of the steps, and processor time of all threads.
    neighbours : float
        Neighbours of a particle: the volume of its support over that of a particle.
    threads : int
        Threads in use.
    shares : dict of float
        Share of every phase in the time of a step.
    bytes_per_particle : float
        Largest size of all arrays during a step, over the particles.
    limits : MachineLimits
        What the machine can do.
    """

    particles: int
    steps: int
    seconds: float
    cpu_seconds: float
    neighbours: float
    threads: int
    shares: dict[str, float]
    bytes_per_particle: float
    limits: MachineLimits

    @property
    def particle_steps_per_s(self) -> float:
        """Particles times steps per second."""
        return self.particles * self.steps / self.seconds

    @property
    def pair_interactions_per_s(self) -> float:
        """Neighbours visited per second, two passes a step, each pair counted from both sides."""
        return _PASSES * self.neighbours * self.particle_steps_per_s

    @property
    def pair_gflops(self) -> float:
        """Arithmetic spent on true neighbours [1e9/s], candidates beyond them not counted."""
        return 1e-9 * _PAIR_OPERATIONS * self.pair_interactions_per_s

    def to_json(self) -> dict[str, Any]:
        """Return the public keys."""
        return {
            "particle_steps_per_s": self.particle_steps_per_s,
            "pair_interactions_per_s": self.pair_interactions_per_s,
            "threads": self.threads,
            "device": "cpu",
            "particles": self.particles,
            "neighbours": self.neighbours,
            "steps": self.steps,
            "wall_s": self.seconds,
            "cpu_s": self.cpu_seconds,
            "phase_shares": self.shares,
            "bytes_per_particle": self.bytes_per_particle,
            "pair_gflops": self.pair_gflops,
            "machine_gflops": self.limits.gflops,
            "machine_gb_per_s": self.limits.bandwidth,
        }

    def lines(self) -> list[str]:
        """Return the figures for a person."""
        phases = ", ".join(f"{name} {share:.1%}" for name, share in self.shares.items())
        part = self.pair_gflops / self.limits.gflops
        return [
            f"{self.particles} particles, {self.steps} steps, {self.threads} threads: {self.seconds:.2f} s",
            f"{self.particle_steps_per_s:.4g} particle-steps/s",
            f"{self.pair_interactions_per_s:.4g} pair interactions/s ({self.neighbours:.0f} neighbours)",
            f"time: {phases}",
            f"memory: {self.bytes_per_particle:.0f} bytes a particle",
            f"machine: {self.limits.gflops:.0f} GFLOP/s single precision, {self.limits.bandwidth:.1f} GB/s; "
            f"the pairs take {self.pair_gflops:.1f} GFLOP/s, {part:.0%} of it",
        ]


@dataclass(frozen=True)
class CardFigures:
    """Speed of flapping wings in a half model on a graphics card.

    Attributes
    ----------
    card : str
        Name of the card.
    particles, steps : int
        Size and length of the measurement.
    seconds : float
        Wall time of the steps.
    neighbours : float
        Neighbours of a particle.
    shares : dict of float
        Share of the time in which the host starts kernels, waits for the card and moves the wings.
    """

    card: str
    particles: int
    steps: int
    seconds: float
    neighbours: float
    shares: dict[str, float]

    @property
    def particle_steps_per_s(self) -> float:
        """Particles times steps per second."""
        return self.particles * self.steps / self.seconds

    def to_json(self) -> dict[str, Any]:
        """Return the public keys."""
        return {
            "particle_steps_per_s": self.particle_steps_per_s,
            "pair_interactions_per_s": _PASSES * self.neighbours * self.particle_steps_per_s,
            "device": "cuda",
            "card": self.card,
            "particles": self.particles,
            "neighbours": self.neighbours,
            "steps": self.steps,
            "wall_s": self.seconds,
            "phase_shares": self.shares,
            "least_particle_steps_per_s": _LEAST,
            "aim_particle_steps_per_s": _AIM,
        }

    def lines(self) -> list[str]:
        """Return the figures for a person."""
        phases = ", ".join(f"{name} {share:.1%}" for name, share in self.shares.items())
        rate = self.particle_steps_per_s
        return [
            f"{self.card}: {self.particles} particles, {self.steps} steps: {self.seconds:.2f} s",
            f"{rate:.4g} particle-steps/s: {rate / _LEAST:.2f} of the {1e-6 * _LEAST:.0f} million wanted, "
            f"{rate / _AIM:.2f} of the {1e-6 * _AIM:.0f} million aimed at",
            f"{_PASSES * self.neighbours * rate:.4g} pair interactions/s ({self.neighbours:.0f} neighbours)",
            f"time of the host: {phases}",
        ]


def measure_card(particles: int, seconds: float = 10.0) -> CardFigures:
    """Time the solver on the graphics card for about ``seconds`` [s]; the first steps compile the kernels."""
    case = sized_case(particles)
    solver = make_solver("cuda", case.flow, case.motion(), case.airspeed)
    for _ in range(3):
        solver.step()
    before = dict(solver.timers.seconds)
    started, steps = time.perf_counter(), 0
    while steps < 5 or time.perf_counter() - started < seconds:
        solver.step()
        steps += 1
    wall = time.perf_counter() - started
    spent = {name: total - before.get(name, 0.0) for name, total in solver.timers.seconds.items()}
    return CardFigures(
        card=card_name("cuda") or "",
        particles=solver.particles,
        steps=steps,
        seconds=wall,
        neighbours=_neighbours(case),
        shares={name: total / wall for name, total in spent.items()},
    )


def measure(particles: int, seconds: float = 10.0) -> Figures:
    """Time the solver on a case of about ``particles`` particles for about ``seconds`` [s].

    The first steps, which compile, are not counted.
    """
    case = sized_case(particles)
    solver = Solver(case.flow, case.motion(), case.airspeed)
    for _ in range(3):
        solver.step()
    before = dict(solver.timers.seconds)
    started, cpu, steps = time.perf_counter(), time.process_time(), 0
    while steps < 5 or time.perf_counter() - started < seconds:
        solver.step()
        steps += 1
    wall, cpu = time.perf_counter() - started, time.process_time() - cpu
    spent = {name: seconds - before.get(name, 0.0) for name, seconds in solver.timers.seconds.items()}
    return Figures(
        particles=solver.particles,
        steps=steps,
        seconds=wall,
        cpu_seconds=cpu,
        neighbours=_neighbours(case),
        threads=numba.get_num_threads(),
        shares={name: seconds / wall for name, seconds in spent.items()},
        bytes_per_particle=_largest_size(case) / solver.particles,
        limits=measure_limits(),
    )


def _neighbours(case: Case) -> float:
    """Volume of the support over that of a particle."""
    return 4.0 / 3.0 * math.pi * (2.0 * case.flow.resolution.h_over_dp) ** 3


def _largest_size(case: Case) -> int:
    """Largest size of all arrays during the first steps of a case [bytes]."""
    tracemalloc.start()
    try:
        solver = Solver(case.flow, case.motion(), case.airspeed)
        for _ in range(2):
            solver.step()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def sized_case(particles: int) -> Case:
    """Return the half model with the spacing that fills its box with about ``particles`` particles."""
    base = cases.preset("smoke")
    box = Box()  # roomy enough for large spacings
    dp = (0.5 * box.length * box.width * box.height / particles) ** (1.0 / 3.0)
    gap = math.degrees(math.asin(min(0.3, 2.0 * dp / (1.4 * base.wing.length))))
    kinematics = replace(base.kinematics, clap_half_gap_deg=max(gap, 2.5))
    resolution = replace(base.flow.resolution, dp=dp)
    return replace(
        base, preset="bench", kinematics=kinematics, flow=replace(base.flow, resolution=resolution, box=box)
    )
