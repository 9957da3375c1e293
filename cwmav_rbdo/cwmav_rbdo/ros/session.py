# SPDX-License-Identifier: Apache-2.0
"""Nodes as processes, and a client that talks to them: what the demo and the end-to-end test are made of."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from threading import Thread
from types import TracebackType
from typing import IO, Any

import rclpy
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

from cwmav_common.errors import InputError, WorkError

_PATIENCE = 15.0  # s for a node to end after SIGINT
_LOOK = 0.1  # s between looks whether the processes still live
_LAST_LINES = 15


def find_executable(package: str, name: str) -> Path:
    """Find ``lib/<package>/<name>`` as `ros2 run` does, and in the environment of this Python.

    Raises
    ------
    InputError
        It is in none of the places; the message lists them.
    """
    prefixes = [p for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    candidates = [Path(prefix) / "lib" / package / name for prefix in [*prefixes, sys.prefix]]
    for candidate in candidates:
        if os.access(candidate, os.X_OK):
            return candidate
    places = ", ".join(str(candidate) for candidate in candidates)
    raise InputError(f"the node {name} of {package} is not installed; looked for {places}")


class NodeProcesses:
    """Nodes started from their executables; all of them are stopped at the end, whatever happened.

    Parameters
    ----------
    domain : ROS domain of the nodes; they are heard on this machine only
    """

    def __init__(self, domain: int) -> None:
        self.environment = os.environ | {
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        self._running: dict[str, tuple[subprocess.Popen[bytes], IO[bytes]]] = {}

    def __enter__(self) -> NodeProcesses:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: Any, trace: TracebackType | None) -> None:
        for name in list(self._running):
            self.stop(name)

    def start(
        self, package: str, executable: str, parameters: Mapping[str, Any], remaps: Sequence[str] = ()
    ) -> int:
        """Start a node, named in messages by `executable`; give its process id."""
        command = [str(find_executable(package, executable)), "--ros-args"]
        for key, value in parameters.items():
            text = str(value).lower() if isinstance(value, bool) else str(value)
            command += ["-p", f"{key}:={text}"]
        for remap in remaps:
            command += ["-r", remap]
        log = tempfile.TemporaryFile()  # noqa: SIM115 - closed when the process is stopped
        process = subprocess.Popen(  # noqa: S603
            command, env=self.environment, stdout=log, stderr=subprocess.STDOUT, start_new_session=True
        )
        self._running[executable] = (process, log)
        return process.pid

    def stop(self, executable: str, number: int = signal.SIGINT) -> int:
        """Stop a node and give its exit status; one that does not listen is killed, with all it started."""
        process, log = self._running.pop(executable)
        if process.poll() is None:
            process.send_signal(number)
        try:
            status = process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            status = process.wait()
        log.close()
        return status

    def check(self) -> None:
        """Raise WorkError when one of the nodes has ended by itself, with the last of what it said."""
        for name, (process, log) in self._running.items():
            status = process.poll()
            if status is not None:
                log.seek(0)
                lines = log.read().decode("utf-8", "replace").splitlines()[-_LAST_LINES:]
                raise WorkError(f"{name} ended with status {status}:\n" + "\n".join(lines))


class Client:
    """A node that calls services and actions of the others and watches that they live.

    Parameters
    ----------
    domain : ROS domain
    check : called while waiting; raises when waiting has become pointless
    """

    def __init__(self, domain: int, check: Callable[[], None] = lambda: None) -> None:
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain)
        self.node = rclpy.create_node("cwmav_demo", context=self._context)
        self._check = check
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = Thread(target=self._executor.spin, name="executor", daemon=True)
        self._thread.start()

    def __enter__(self) -> Client:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: Any, trace: TracebackType | None) -> None:
        self._executor.shutdown(timeout_sec=5.0)
        self._thread.join(timeout=5.0)
        self.node.destroy_node()
        self._context.try_shutdown()

    def call(self, service_type: Any, name: str, deadline: float, **fields: Any) -> Any:
        """Call a service.

        Raises
        ------
        WorkError
            It is not there in time, does not answer in time, or says that it had no success.
        """
        client = self.node.create_client(service_type, name)
        end = time.monotonic() + deadline
        self._wait(client.service_is_ready, end, f"the service {name} is not offered")
        future = client.call_async(service_type.Request(**fields))
        self._wait(future.done, end, f"the service {name} does not answer")
        self.node.destroy_client(client)
        response = future.result()
        if not getattr(response, "success", True):
            raise WorkError(f"{name}: {response.message}")
        return response

    def act(
        self,
        action_type: Any,
        name: str,
        deadline: float,
        on_feedback: Callable[[Any], None] = lambda feedback: None,
        **fields: Any,
    ) -> Any:
        """Send a goal, hand its feedback on, and give the result; cancelled when interrupted.

        Raises
        ------
        WorkError
            The action is not offered in time or ends without success.
        """
        client = ActionClient(self.node, action_type, name)
        self._wait(client.server_is_ready, time.monotonic() + deadline, f"the action {name} is not offered")
        sent = client.send_goal_async(
            action_type.Goal(**fields), feedback_callback=lambda message: on_feedback(message.feedback)
        )
        self._wait(sent.done, time.monotonic() + deadline, f"the action {name} does not answer")
        goal = sent.result()
        result = goal.get_result_async()
        try:
            self._wait(result.done, None, "")
        except BaseException:
            goal.cancel_goal_async()
            raise
        answer = result.result().result
        client.destroy()
        if not answer.success:
            raise WorkError(f"{name}: {answer.message}")
        return answer

    def _wait(self, ready: Callable[[], bool], end: float | None, complaint: str) -> None:
        while not ready():
            self._check()
            if end is not None and time.monotonic() > end:
                raise WorkError(complaint)
            time.sleep(_LOOK)


def free_domain() -> int:
    """Choose a ROS domain for private use, below those whose ports the system hands out."""
    return 1 + os.getpid() % 100
