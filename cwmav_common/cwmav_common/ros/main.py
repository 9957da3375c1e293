# SPDX-License-Identifier: Apache-2.0
"""Start and stop of a node as a program."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Sequence

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from cwmav_common.cli import message
from cwmav_common.errors import CwmavError

_STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def run(make: Callable[[], Node], arguments: Sequence[str] | None = None) -> int:
    """Spin the node that `make` gives until SIGINT or SIGTERM; give the exit status.

    ``node.close()`` must stop its work and end its processes.

    The executor is single-threaded: with the interpreter's one lock several threads are slower and lose
    messages. It spins beside the main thread, which sleeps until a signal comes. The context stays valid
    until the node has closed, so its last words (ended goals, final diagnostics) still get out.
    """
    stop = threading.Event()
    for number in _STOP_SIGNALS:
        signal.signal(number, lambda *_: stop.set())
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # rclpy raises several kinds for arguments it cannot parse
        message(f"error: {' '.join(str(error).split())}")
        return 2
    try:
        return _spin(make(), stop)
    except CwmavError as error:
        message(f"error: {error}")
        return error.exit_status
    finally:
        rclpy.try_shutdown()


def main(make: Callable[[], Node]) -> None:
    """Run the node and exit with its status.

    A launch system and the terminal may both ask it to stop; the second signal must not kill the interpreter
    while it shuts down, so that the exit status still tells how the node ended.
    """
    status = run(make, sys.argv)
    for number in _STOP_SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    raise SystemExit(status)


def _spin(node: Node, stop: threading.Event) -> int:
    failures: list[BaseException] = []
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def spin() -> None:
        try:
            executor.spin()
        except ExternalShutdownException:
            pass
        except BaseException as error:
            failures.append(error)
        finally:
            stop.set()

    thread = threading.Thread(target=spin, name="executor")
    thread.start()
    stop.wait()
    node.close()
    executor.shutdown(timeout_sec=5.0)
    thread.join(timeout=5.0)
    node.destroy_node()
    if failures:
        raise failures[0]
    return 0
