# SPDX-License-Identifier: Apache-2.0
"""What a run and a verification say to a person."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from cwmav_sim.result import LiftResult
from cwmav_sim.verification.protocol import Check


def check_lines(checks: Sequence[Check]) -> list[str]:
    """Return a line per check: passed or not, found, reference, error and what is allowed."""
    return [
        f"{'ok  ' if c.passed else 'FAIL'} {c.name:22} {c.quantity}: {c.value:.5g} against {c.reference:.5g}"
        f" ({c.error_percent:+.2f} %, allowed {c.tolerance_percent:g} %)"
        for c in checks
    ]


def result_lines(result: LiftResult) -> list[str]:
    """Return the means with their uncertainties, the cycles, the cost and the source of a run."""
    trend = ", ".join(f"{value:.4f}" for value in result.cycle_lift)
    return [
        f"lift    {result.mean_lift:.4f} +- {result.lift_std:.4f} N",
        f"drag    {result.mean_drag:.4f} +- {result.drag_std:.4f} N",
        f"power   {result.mean_power:.4f} W given to the air",
        f"cycles  {result.cycles}, mean lift of each {trend} N"
        f" ({'periodic' if result.periodic else 'not periodic'})",
        f"run     {result.particles} particles, {result.steps} steps, {result.wall_s:.1f} s,"
        f" {result.particle_steps_per_s:.3g} particle-steps/s",
        *_detail_lines(result.details),
        f"source  {result.source()}",
    ]


def _detail_lines(details: Mapping[str, Any]) -> list[str]:
    """Return parts of the lift, moment, balances and cost, as far as a result has them."""
    lines = []
    if parts := details.get("parts"):
        lift = ", ".join(f"{n} {_with_std(parts[n]['lift_n'])}" for n in ("pressure", "viscous", "inertial"))
        lines.append(f"parts   {lift} N of the lift; pitch moment {_with_std(parts['pitch_moment_n_m'])} N m")
    if balance := details.get("balance"):
        lines.append(
            f"balance particles lost {balance['particles_lost']}, put back {balance['particles_put_back']}, "
            f"let through {balance.get('particles_let_through', 0)} "
            f"(leak {balance['leak_flux_m_s']:.2g} m/s), momentum {balance['momentum_residual']:.1g}"
        )
        if wings := balance.get("wings_j"):
            share = abs(wings["made_by_exchange"] / (balance["air_j"]["work_of_wings"] or 1.0))
            drive = wings["drive_work"]
            lines.append(f"wings   driven with {drive:.3g} J, exchange with the air closes to {share:.1%}")
    if cost := details.get("cost"):
        seconds = cost["phases_s"]
        total = sum(seconds.values()) or 1.0
        phases = ", ".join(f"{name} {100 * s / total:.0f} %" for name, s in seconds.items())
        where = f" on {cost['card']}" if "card" in cost else ""
        lines.append(f"cost    {cost['pair_interactions_per_s']:.3g} pairs/s{where}; {phases}")
    return lines


def _with_std(value: Mapping[str, float]) -> str:
    return f"{value['mean']:.4f} +- {value['std']:.4f}"
