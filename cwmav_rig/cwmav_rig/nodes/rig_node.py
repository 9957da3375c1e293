# SPDX-License-Identifier: Apache-2.0
"""The node ``/rig``: replays a recording or runs live instruments, measures the scatter, answers for power.

It has a life cycle: configure opens the recording or identifies the instruments, activate lets them stream,
deactivate stops them. By default it goes through the first two by itself.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rosgraph_msgs.msg import Clock as ClockMessage
from std_srvs.srv import Trigger

from cwmav_common.errors import CwmavError, InputError
from cwmav_common.mcap_reader import open_recording
from cwmav_common.ros.calls import CallQueue
from cwmav_common.ros.codecs import nanoseconds, time_message
from cwmav_common.ros.diagnostics import Diagnostics, Health
from cwmav_common.ros.main import main as run_main
from cwmav_common.ros.parameters import Parameters
from cwmav_rig.live import CycleEvent
from cwmav_rig.replay import Player
from cwmav_rig.ros.answers import Answers
from cwmav_rig.ros.follow import CycleFollower
from cwmav_rig.ros.live import LiveBench, check_bench
from cwmav_rig.ros.player_services import Pause, Resume, Seek, SetRate
from cwmav_rig.ros.publish import RigPublisher
from cwmav_rig.ros.settings import RigSettings
from cwmav_rig.ros.work import analyse_recording, load_power_model, read_map
from cwmav_rig.topic_map import TopicMap, resolve

TICK = 0.01  # s, how often the replay looks what is due
SUCCESS, FAILURE, ERROR = (
    TransitionCallbackReturn.SUCCESS,
    TransitionCallbackReturn.FAILURE,
    TransitionCallbackReturn.ERROR,
)


class RigNode(LifecycleNode):
    """Adapter between ROS and the rig.

    Parameters
    ----------
    analyse : work of an analysis, in another process: ``analyse(recording, topic_map, window, channel)``
    load_power : work of making the power model: ``load_power(path, topic_map, channel)``
    options : keyword arguments of the rclpy node
    """

    def __init__(
        self,
        analyse: Callable[..., Any] = analyse_recording,
        load_power: Callable[..., Any] = load_power_model,
        **options: Any,
    ) -> None:
        super().__init__("rig", **options)
        self.parameters = Parameters(self, RigSettings, check=self._check, on_change=self._on_change)
        settings = self.settings
        self._calls = CallQueue(self)
        self._publisher = RigPublisher(self, settings.wrench_rate, settings.tare_seconds)
        self._answers = Answers(
            self, self._calls, lambda: self.settings, self._current_recording, analyse, load_power
        )
        self._clock_publisher = self.create_publisher(ClockMessage, "/clock", 10)
        self._player: Player | None = None
        self._live: LiveBench | None = None
        self._state, self._trouble = "unconfigured", ""
        self._cycles = CycleFollower(lambda event: self._calls.post(lambda: self._take_cycle(event)))
        self._loops = 0
        self._opened: tuple[str, str] = ("", "")
        self._counts = {"messages replayed": 0, "messages live": 0, "cycles": 0}
        self._timer = self.create_timer(TICK, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._offer_services()
        self._diagnostics = Diagnostics(self, "cwmav rig")
        self._diagnostics.add("replay", self._health)
        self._answers.power_job()
        if settings.autostart and self.trigger_configure() == SUCCESS:
            self.trigger_activate()

    @property
    def settings(self) -> RigSettings:
        """The parameters, one consistent set."""
        return self.parameters.value

    def close(self) -> None:
        """Stop replay and work."""
        self._timer.cancel()
        self._answers.close()
        self._cycles.close()
        self._calls.close()
        self._disconnect()

    def _offer_services(self) -> None:
        self.create_service(Pause, "~/pause", self._pause)
        self.create_service(Resume, "~/resume", self._resume)
        self.create_service(Seek, "~/seek", self._seek)
        self.create_service(SetRate, "~/set_rate", self._set_rate)
        self.create_service(Trigger, "~/tare", self._tare)

    # --- life cycle ----------------------------------------------------------------------------------------

    def on_configure(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Open the recording, or open and identify the instruments."""
        self._trouble = ""
        try:
            if self.settings.bench:
                self._open_bench(self.settings.bench)
            else:
                self._open(self.settings)
        except CwmavError as error:
            return self._refuse("configure", error)
        self._state = "inactive"
        return SUCCESS

    def on_activate(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Let the instruments stream and record, or play."""
        try:
            if self._live is not None:
                self._live.start(self.settings.record_folder)
                self._timer.reset()
        except CwmavError as error:
            return self._refuse("activate", error)
        self._state = "active"
        if self._player is not None and not self.settings.start_paused:
            self._play(self._player)
        return SUCCESS

    def on_deactivate(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Stop streaming or playing; what was recorded is complete then."""
        self._state = "inactive"
        if self._player is not None:
            self._player.pause()
        if self._live is not None:
            self._live.stop()
        return ERROR if self._trouble else SUCCESS

    def on_cleanup(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Let go of recording and instruments."""
        self._disconnect()
        return SUCCESS

    def on_shutdown(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Let go of everything for good."""
        self._disconnect()
        return SUCCESS

    def on_error(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Let go of everything; the node can be configured again."""
        self._disconnect()
        return SUCCESS

    def _refuse(self, transition: str, error: CwmavError) -> TransitionCallbackReturn:
        self._trouble = str(error)
        self.get_logger().error(f"{transition}: {error}")
        return FAILURE

    def _disconnect(self) -> None:
        self._state, self._opened = "unconfigured", ("", "")
        if self._player is not None:
            self._player.close()
            self._player = None
        if self._live is not None:
            for name in self._live.identities:
                self._diagnostics.remove(name)
            self._live.close()
            self._live = None

    def _open_bench(self, path: str) -> None:
        self._disconnect()
        live = LiveBench(path)
        self._live = live
        for name in live.identities:
            self._diagnostics.add(name, partial(live.health_of, name))
        self._cycles.begin(live.topic_map, live.topics, path)
        self._publisher.use(live.topic_map)

    def _unplugged(self, live: LiveBench) -> None:
        """Go to the error state of the life cycle, and from there to unconfigured."""
        self._trouble = live.failed
        self.get_logger().error(self._trouble)
        self.trigger_deactivate()

    # --- parameters ----------------------------------------------------------------------------------------

    def _check(self, settings: RigSettings) -> None:
        if settings.publish_clock and self.get_parameter("use_sim_time").value:
            raise InputError(
                "publish_clock and use_sim_time exclude each other: the node would wait for itself"
            )
        if settings.bench and settings.recording:
            raise InputError("bench and recording are both given; allowed: one of them")
        if settings.bench:
            check_bench(settings.bench)
        if settings.recording and (settings.recording, settings.topic_map) != getattr(self, "_opened", None):
            with open_recording(settings.recording) as recording:
                resolve(recording, read_map(settings.topic_map))
        if settings.power_model and not Path(settings.power_model).exists():
            raise InputError(
                f"power_model {settings.power_model}: no such file or folder; allowed: a model or recordings"
            )

    def _on_change(self, settings: RigSettings) -> None:
        self._publisher.wrench_rate = settings.wrench_rate
        self._publisher.tare_seconds = settings.tare_seconds
        if self._state != "unconfigured" and (settings.recording, settings.topic_map) != self._opened:
            self._open(settings)
            if self._state == "active" and self._player is not None and not settings.start_paused:
                self._play(self._player)
        if self._player is not None:
            self._player.loop = settings.loop
            if settings.rate != self._player.rate:
                self._player.set_rate(settings.rate)
        self._answers.power_job()

    # --- replay --------------------------------------------------------------------------------------------

    def _open(self, settings: RigSettings) -> None:
        if self._player is not None:
            self._player.close()
        self._player = None
        if self._live is not None and not settings.recording:
            return
        self._opened = (settings.recording, settings.topic_map)
        if not settings.recording:
            return
        recording = open_recording(settings.recording)
        topic_map: TopicMap = resolve(recording, read_map(settings.topic_map))
        clock = self._ros_seconds if self.get_parameter("use_sim_time").value else time.monotonic
        self._player = Player(
            recording,
            rate=settings.rate,
            loop=settings.loop,
            start_offset=settings.start_offset,
            clock=clock,
        )
        self._cycles.begin(topic_map, recording.topics, settings.recording)
        self._publisher.use(topic_map)
        self._loops = 0

    def _ros_seconds(self) -> float:
        return float(self.get_clock().now().nanoseconds) * 1e-9

    def _tick(self) -> None:
        if self._live is not None and self._live.streaming:
            self._pass_on(self._live)
            return
        player = self._player
        if player is None or not player.running:
            self._timer.cancel()  # an idle node does not tick; starting the replay resets the timer
            return
        messages = player.poll()
        if player.loops != self._loops:
            self._loops = player.loops
            self._restart()
        for message in messages:
            self._publisher.publish(message)
        self._cycles.add(messages)
        self._counts["messages replayed"] += len(messages)
        if self.settings.publish_clock:
            self._clock_publisher.publish(ClockMessage(clock=time_message(player.recorded_time_ns)))

    def _pass_on(self, live: LiveBench) -> None:
        messages = live.take()
        for message in messages:
            self._publisher.publish(message)
        self._cycles.add(messages)
        self._counts["messages live"] += len(messages)
        if live.failed:
            self._unplugged(live)

    def _restart(self) -> None:
        self._publisher.restart()
        self._cycles.restart()

    def _take_cycle(self, event: CycleEvent) -> None:
        self._counts["cycles"] += 1
        self._publisher.publish_cycle(event)

    def _loaded(self) -> Player:
        if self._player is None:
            raise InputError("no recording is loaded; set the parameter 'recording'")
        return self._player

    def _pause(self, _: Any, response: Any) -> Any:
        if self._player is not None:
            self._player.pause()
        return response

    def _play(self, player: Player) -> None:
        if self._state != "active":
            raise InputError(f"the node is {self._state}; activate it first")
        player.start()
        self._timer.reset()

    def _resume(self, _: Any, response: Any) -> Any:
        if self._player is not None:
            try:
                self._play(self._player)
            except InputError as error:
                self.get_logger().warning(f"resume: {error}")
        return response

    def _seek(self, request: Any, response: Any) -> Any:
        try:
            player = self._loaded()
            begin = player.recording.span_ns[0]
            player.seek((nanoseconds(request.time) - begin) * 1e-9)
            self._restart()
            response.success = True
        except InputError as error:
            self.get_logger().warning(f"seek: {error}")
            response.success = False
        return response

    def _set_rate(self, request: Any, response: Any) -> Any:
        try:
            self._loaded().set_rate(request.rate)
            response.success = True
        except InputError as error:
            self.get_logger().warning(f"set_rate: {error}")
            response.success = False
        return response

    def _tare(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            response.message, response.success = self._publisher.tare(), True
        except InputError as error:
            response.message, response.success = str(error), False
        return response

    # --- health --------------------------------------------------------------------------------------------

    def _current_recording(self) -> str:
        """Name what is replayed, or recorded from live instruments; empty when neither."""
        if self._live is not None and self._live.recording is not None:
            return str(self._live.recording)
        return self.settings.recording

    def _health(self) -> Health:
        player = self._player
        values: dict[str, Any] = {
            **self._counts,
            **self._answers.counts,
            **self._publisher.skipped,
            "worker deaths": self._answers.pool.deaths,
        }
        if self._trouble:
            return Health(self._trouble, "error", values)
        if self._live is not None:
            where = f", recorded into {self._live.recording}" if self._live.recording is not None else ""
            return Health(
                f"{len(self._live.identities)} live instruments, {self._state}{where}", values=values
            )
        if player is None:
            return Health("no recording", values=values)
        state = "playing" if player.running else "finished" if player.finished else "paused"
        values |= {"position [s]": f"{player.position:.3f}", "rate": player.rate, "loops": player.loops}
        problems = player.recording.problems
        if problems or self._publisher.skipped:
            notes = [*problems, *(f"{what} is not published" for what in self._publisher.skipped)]
            return Health(f"{state}; {'; '.join(notes)}", "warn", values)
        return Health(f"{state}, {player.position:.1f} of {player.duration:.1f} s", values=values)


def main() -> None:
    """Run the node until SIGINT."""
    run_main(RigNode)


if __name__ == "__main__":
    main()
