"""Node ``player``: publishes a recorded run again, ``/clock`` included.

With ``without: controller`` it plays the plant and the sensors in lock-step and
leaves the torque to a controller of the user's: each tick goes out when the
torque of the one before has come.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import rclpy
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from flexarm_ros.bag.errors import BagError
from flexarm_ros.bag.reader import BagReader
from flexarm_ros.nodes.endpoints import NO_OVERRIDES
from flexarm_ros.nodes.graph import message_class, qos_profile
from flexarm_ros.nodes.lockstep import RunFailed
from flexarm_ros.nodes.standin import ControllerSeat

_PARAMETERS: dict[str, tuple[Any, str]] = {
    "bag": ("", "the run: its directory, or the bag in it"),
    "rate": (1.0, "multiple of real time; 0: as fast as it goes; may change while playing"),
    "start": (0.0, "simulated time to start from [s]"),
    "loop": (False, "start again at the end"),
    "paused": (False, "wait for the service ~/resume or ~/play_next before the first tick"),
    "topics": ("", "topics to publish, comma separated; empty: all"),
    "without": ("", "controller: leave the torque to another node, in lock-step"),
    "delay": (1.0, "wall time to wait for subscribers before the first message [s]"),
    "tick_timeout": (5.0, "wall time that the controller may take to answer a tick [s]"),
}


class PlayerError(Exception):
    """A parameter of the player that cannot be; one line."""


class PlayerNode(Node):
    """Plays one bag; see the module's text for its parameters and services."""

    def __init__(self) -> None:
        super().__init__("player")
        for name, (default, doc) in _PARAMETERS.items():
            descriptor = ParameterDescriptor(description=doc, read_only=name != "rate")
            if name == "rate":
                descriptor.floating_point_range = [FloatingPointRange(from_value=0.0, to_value=1e6)]
            try:
                self.declare_parameter(name, default, descriptor)
            except Exception as error:
                raise PlayerError(f"{name}: {str(error).splitlines()[0]}") from None
        self.reader = BagReader(self._text("bag"))
        self.timeline = self.reader.timeline
        self.without = self._text("without")
        if self.without not in ("", "controller"):
            raise PlayerError(f"without: {self.without!r} is not allowed: empty or controller")
        self._rate = float(self.get_parameter("rate").value or 0.0)
        self._paused = bool(self.get_parameter("paused").value)
        self._steps = 0
        self._wake = threading.Condition()
        self._chosen = self._choose_topics()
        self._outlets = {
            index: self.create_publisher(
                message_class(topic.type_name), topic.name, qos_profile(topic.qos),
                qos_overriding_options=NO_OVERRIDES,
            )
            for index, topic in enumerate(self.reader.topics)
            if index in self._chosen
        }  # fmt: skip
        self.add_on_set_parameters_callback(self._set_rate)
        for name, action in (
            ("pause", self._pause), ("resume", self._resume), ("play_next", self._play_next),
            ("toggle_paused", self._toggle),
        ):  # fmt: skip
            self.create_service(Trigger, f"~/{name}", action)
        self.played = 0
        # Made here, before the services' thread spins: rclpy makes no promise for later.
        self._seat = ControllerSeat(self, self.reader.config) if self.without else None

    def _text(self, name: str) -> str:
        return str(self.get_parameter(name).value or "")

    def _choose_topics(self) -> set[int]:
        """Return the indices of the topics to publish; PlayerError names an unknown one."""
        names = {topic.path: index for index, topic in enumerate(self.reader.topics)}
        wanted = [text.strip() for text in self._text("topics").split(",") if text.strip()]
        chosen = set()
        for text in wanted or list(names):
            path = text if text.startswith("/") else "/" + text
            if path not in names:
                raise PlayerError(f"topics: {text!r} is not in the bag: {', '.join(names)}")
            chosen.add(names[path])
        if self.without == "controller":
            chosen.discard(names["/joint_command"])
        return chosen

    # --- services --------------------------------------------------------------------

    def _change(self, paused: bool, steps: int, response: Any, text: str) -> Any:
        with self._wake:
            self._paused, self._steps = paused, self._steps + steps
            self._wake.notify_all()
        response.success, response.message = True, text
        return response

    def _pause(self, _: Any, response: Any) -> Any:
        return self._change(True, 0, response, "paused")

    def _resume(self, _: Any, response: Any) -> Any:
        return self._change(False, 0, response, "playing")

    def _toggle(self, _: Any, response: Any) -> Any:
        return self._change(not self._paused, 0, response, "playing" if self._paused else "paused")

    def _play_next(self, _: Any, response: Any) -> Any:
        if not self._paused:
            response.success, response.message = False, "not paused"
            return response
        return self._change(True, 1, response, "one tick")

    def _set_rate(self, parameters: list[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            if parameter.name == "rate":
                with self._wake:
                    self._rate = float(parameter.value)
                    self._wake.notify_all()
        return SetParametersResult(successful=True)

    # --- playing ----------------------------------------------------------------------

    def play(self) -> None:
        """Publish the run; returns at its end, or when the context is shut down.

        Raises RunFailed where a controller that was waited for did not answer,
        BagError where the bag is damaged.
        """
        seat = self._seat
        if seat is not None:
            seat.wait_for_controller()
        else:
            self._pause_for(float(self.get_parameter("delay").value or 0.0))
        while True:
            self._play_once(seat)
            if not self.get_parameter("loop").value or seat is not None or not self.context.ok():
                break
        if seat is not None:
            seat.leave(self.played)
            self.get_logger().info(seat.comparison())

    def flush(self) -> None:
        """Wait until every reader has every message, two seconds at the longest."""
        for publisher in self._outlets.values():
            publisher.wait_for_all_acked(Duration(seconds=2.0))

    def _play_once(self, seat: ControllerSeat | None) -> None:
        previous: int | None = None
        for tick, messages in self._from_start():
            self._pace(1 if previous is None else tick - previous)
            if not self.context.ok():
                return
            for index, data in enumerate(messages):
                if data is not None and index in self._outlets:
                    self._outlets[index].publish(data)
            if seat is not None:
                seat.answer(tick, messages[-1])
            previous = tick
            self.played += 1
        if self.reader.damage is not None:
            raise self.reader.damage

    def _from_start(self) -> Iterator[tuple[int, list[bytes | None]]]:
        first = float(self.get_parameter("start").value or 0.0) * 1e9
        for tick, messages in self.reader.ticks():
            if tick * self.timeline.period_ns >= first:
                yield tick, messages

    def _pace(self, ticks: int) -> None:
        """Wait until the next tick is due: rate, pause and single steps."""
        with self._wake:
            while self._paused and not self._steps and self.context.ok():
                self._wake.wait(0.1)
            if self._steps:
                self._steps -= 1
                self._due = time.monotonic()
                return
            now = time.monotonic()
            if self._rate <= 0.0 or self.played == 0:
                self._due = now
                return
            self._due = max(
                self._due + ticks * self.timeline.period_ns * 1e-9 / self._rate, now - 0.1
            )
            while (left := self._due - time.monotonic()) > 0.0 and self.context.ok():
                if self._paused:
                    break
                self._wake.wait(min(left, 0.1))

    def _pause_for(self, seconds: float) -> None:
        deadline = time.monotonic() + seconds
        while self.context.ok() and (left := deadline - time.monotonic()) > 0.0:
            time.sleep(min(left, 0.05))


def play(argv: list[str]) -> int:
    """Run the player with a ROS command line; 0 done, 1 failed, 2 bad usage."""
    rclpy.init(args=["player", *argv], signal_handler_options=SignalHandlerOptions.NO)
    executor = SingleThreadedExecutor()
    services = threading.Thread(target=_serve, args=(executor,), daemon=True)
    node = None
    try:
        node = PlayerNode()
        executor.add_node(node)
        services.start()
        node.play()
        node.flush()
        node.get_logger().info(f"played {node.played} ticks of {node.reader.path}")
        return 0
    except (BagError, PlayerError) as error:
        print(f"player: {error}", file=sys.stderr)
        return 2
    except RunFailed as failure:
        print(f"player: {failure.reason}", file=sys.stderr)
        return 1
    finally:
        executor.shutdown(timeout_sec=1.0)
        if services.ident is not None:
            services.join(timeout=2.0)
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()


def _serve(executor: SingleThreadedExecutor) -> None:
    with suppress(ExternalShutdownException):
        executor.spin()
