# SPDX-License-Identifier: Apache-2.0
"""Results of runs that never ran, for tests of what is done with results."""

from cwmav_sim.result import LiftResult, Provenance


def result_for(case, lift, lift_std=0.002):
    """Return a complete result of a case with a given lift."""
    return LiftResult(
        flapping_frequency=case.flapping_frequency,
        angle_of_attack_deg=case.angle_of_attack_deg,
        airspeed=case.airspeed,
        mean_lift=lift,
        lift_std=lift_std,
        mean_drag=-0.01,
        drag_std=0.001,
        mean_power=0.5,
        cycle_lift=(0.9 * lift, lift, lift, lift),
        cycles=4,
        periodic=True,
        dp=case.flow.resolution.dp,
        particles=24000,
        steps=4000,
        wall_s=60.0,
        particle_steps_per_s=1.6e6,
        device="cpu",
        preset=case.preset,
        address=case.address(),
        half_model=case.flow.box.symmetric,
        provenance=Provenance.here(),
    )
