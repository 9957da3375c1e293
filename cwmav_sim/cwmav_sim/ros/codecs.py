# SPDX-License-Identifier: Apache-2.0
"""Values of the simulation as messages."""

from __future__ import annotations

from cwmav_msgs.action import Simulate
from cwmav_msgs.msg import LiftSample
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from cwmav_common.cli import to_json
from cwmav_common.ros.codecs import point_cloud, triangle_marker
from cwmav_sim.result import LiftResult
from cwmav_sim.ros.live import Cloud, Surface
from cwmav_sim.run import Progress

_COLOURS = (
    (0.12, 0.47, 0.71, 0.9),
    (0.68, 0.78, 0.91, 0.9),
    (0.84, 0.37, 0.0, 0.9),
    (1.0, 0.73, 0.47, 0.9),
)


def lift_sample(header: Header, run: str, frequency: float, state: Progress) -> LiftSample:
    """Make the message of the forces at one instant."""
    return LiftSample(
        header=header,
        run=run,
        time=float(state.time),
        phase=float(state.time * frequency),
        lift=float(state.lift),
        drag=float(state.drag),
        power=float(state.power),
        mean_lift=float(state.mean_lift),
    )


def wing_markers(header: Header, surface: Surface) -> MarkerArray:
    """One coloured surface for every panel of the wings."""
    markers = MarkerArray()
    for number, name in enumerate(surface.panel_names):
        triangles = surface.triangles[surface.panel == number]
        colour = _COLOURS[number % len(_COLOURS)]
        markers.markers.append(triangle_marker(header, name, surface.positions, triangles, colour))
    return markers


def particle_cloud(header: Header, cloud: Cloud) -> PointCloud2:
    """Particles with velocity and pressure."""
    velocity = {f"v{axis}": cloud.velocity[:, index] for index, axis in enumerate("xyz")}
    return point_cloud(header, cloud.position, velocity | {"pressure": cloud.pressure})


def feedback(state: Progress) -> Simulate.Feedback:
    """How far a run is."""
    return Simulate.Feedback(
        fraction=float(state.fraction),
        time=float(state.time),
        cycle=int(state.cycle),
        cycles=int(state.cycles),
        lift=float(state.lift),
        mean_lift=float(state.mean_lift),
        seconds_left=float(state.seconds_left),
    )


def result_message(result: LiftResult, found: bool) -> Simulate.Result:
    """How a run ended; `found` says that it was in the store."""
    return Simulate.Result(
        success=True,
        message="",
        lift=result.mean_lift,
        lift_std=result.lift_std,
        drag=result.mean_drag,
        power=result.mean_power,
        cycles=result.cycles,
        periodic=result.periodic,
        source=source(result, found),
        result_json=to_json(result.to_json(), indent=None),
    )


def source(result: LiftResult, found: bool) -> str:
    """Where a lift came from."""
    return f"{result.source()}{', stored result' if found else ''}"
