# Copyright 2026 The flexarm_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Node ``player``: publishes a recorded run again, ``/clock`` included.

With ``without: controller`` it plays the plant and the sensors in lock-step with an external
controller: each tick is published when the torque of the previous one has arrived.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
import sys
import threading
import time
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.bag.errors import BagError
from flexarm_ros.bag.reading.reader import BagReader
from flexarm_ros.core.ending import handle_ending
from flexarm_ros.core.parameters.spec import check
from flexarm_ros.core.run.results.real_time import spread
from flexarm_ros.nodes.player.options import declare, PlayerError, PlayerOptions
from flexarm_ros.nodes.player.pace import Pace
from flexarm_ros.nodes.player.recorded_times import RecordedTimes
from flexarm_ros.nodes.player.replay_peer import ControllerSeat
from flexarm_ros.nodes.runtime.errors import RunFailed
from flexarm_ros.nodes.runtime.parameters.own import OWN
from flexarm_ros.nodes.runtime.process.middleware import start
from flexarm_ros.nodes.runtime.process.shutdown_watchdog import shutdown_limit
from flexarm_ros.nodes.runtime.topics.endpoints import NO_OVERRIDES
from flexarm_ros.nodes.runtime.topics.graph import message_class, qos_profile
from flexarm_ros.wire.topics import CLOCK, COMMAND
import numpy as np
from rcl_interfaces.msg import SetParametersResult
import rclpy
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

_UNACKED = 250
"""Most ticks in transit: a quarter of the writers' history, so that none is overwritten."""


class PlayerNode(Node):
    """
    Plays one bag; see the module docstring for its parameters and services.

    ``stop_signal`` (0: none received) ends the replay within a tenth of a second.
    """

    def __init__(self, argv: list[str]) -> None:
        super().__init__('player')
        self.stop_signal = 0
        self.played = 0
        self.options: PlayerOptions = declare(self, argv)
        given = self.options.scenario
        self.reader = BagReader(
            self.options.bag, scenario.load(given, self.options.set) if given else None,
            self.options.namespace or None, self.get_namespace(),
        )  # fmt: skip
        self.timeline = self.reader.timeline
        recorded = self.options.timing == 'recorded'
        self._times = RecordedTimes(self.reader) if recorded else None
        self._wall: float | None = None
        self._first = self._first_tick()
        self._last = self._last_tick()
        self._pace = Pace(self.options.rate, self.options.paused, self.stopped)
        self._outlets = {
            index: self.create_publisher(
                message_class(topic.type_name), topic.name, qos_profile(topic.qos),
                qos_overriding_options=NO_OVERRIDES,
            )
            for index, topic in enumerate(self.reader.topics)
            if index in self._choose_topics()
        }  # fmt: skip
        self.add_on_set_parameters_callback(self._set_rate)
        for name, action in (
            ('pause', self._pause), ('resume', self._resume), ('play_next', self._play_next),
            ('toggle_paused', self._toggle),
        ):  # fmt: skip
            self.create_service(Trigger, f'~/{name}', action)
        # Created here, before the services' thread spins: rclpy does not support it later.
        self._seat: ControllerSeat | None = None
        if self.options.without:
            if self.reader.gaps:
                raise BagError(
                    f'{self.reader.path}: a controller needs every tick: {self.reader.gaps[0]}'
                )
            topics = self.reader.topics
            self._seat = ControllerSeat(
                self, [(topics[i], publisher) for i, publisher in self._outlets.items()],
                self.reader.config, self.timeline, self.options.tick_timeout, self.stopped,
            )  # fmt: skip

    def stopped(self) -> bool:
        """Whether the replay is to end."""
        return bool(self.stop_signal) or not self.context.ok()

    def _first_tick(self) -> int:
        """Return the first tick to play: the first one not before ``start``."""
        first = -(-round(self.options.start * 1e9) // self.timeline.period_ns)
        if first >= self.timeline.ticks:
            end = self.timeline.ticks * self.timeline.period_ns / 1e9
            raise PlayerError(
                f"start: {self.options.start:g} s is not before the run's end at {end:g} s"
            )
        return first

    def _last_tick(self) -> int:
        """Return the last tick that is not after ``start + playback_duration``."""
        if self.options.playback_duration < 0.0:
            return self.timeline.ticks - 1
        end = round(self.options.start * 1e9) + round(self.options.playback_duration * 1e9)
        return max(self._first, end // self.timeline.period_ns)

    def _choose_topics(self) -> set[int]:
        """Return the indices of the topics to publish; PlayerError names an unknown one."""
        chosen = {CLOCK, *(self._named('topics') or self.reader.names)}
        chosen -= self._named('exclude')
        if self.options.without:
            chosen.discard(COMMAND)
        return chosen

    def _named(self, option: str) -> set[int]:
        """Return the indices of the topics that the parameter ``option`` lists."""
        names = {self.reader.topics[index].path: index for index in sorted(self.reader.names)}
        chosen = set()
        for text in getattr(self.options, option):
            path = text if text.startswith('/') else '/' + text
            if path not in names:
                raise PlayerError(f"{option}: '{text}' is not in the bag: {', '.join(names)}")
            chosen.add(names[path])
        return chosen

    # --- services --------------------------------------------------------------------

    def _pause(self, _: Any, response: Any) -> Any:
        self._pace.pause(True)
        return _answer(response, 'paused')

    def _resume(self, _: Any, response: Any) -> Any:
        self._pace.pause(False)
        return _answer(response, 'playing')

    def _toggle(self, request: Any, response: Any) -> Any:
        return (self._resume if self._pace.paused else self._pause)(request, response)

    def _play_next(self, _: Any, response: Any) -> Any:
        stepped = self._pace.step()
        return _answer(response, 'one tick' if stepped else 'not paused', stepped)

    def _set_rate(self, parameters: list[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            if parameter.name == 'rate':
                try:
                    spec = OWN['player']['rate'].spec
                    self._pace.set_rate(check('rate', spec, parameter.value))
                except ValueError as error:
                    return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    # --- playing ----------------------------------------------------------------------

    def play(self) -> None:
        """
        Publish the run; returns at its end, or when it is stopped.

        Raises RunFailed if the controller did not answer, BagError if the bag is damaged or has
        nothing to play.
        """
        seat = self._seat
        if seat is None:
            self._wait_for_subscribers()
            while True:
                before = self.played
                self._play_once(None)
                if self.stopped():
                    return
                if self.played == before:
                    raise BagError(f'{self.reader.path}: no tick from {self.options.start:g} s on')
                if not self.options.loop:
                    return
        try:
            seat.wait_for_controller()
            self._play_once(seat)
            if self._times is not None:
                seat.hear_last()
        except (RunFailed, BagError) as error:
            seat.leave(self.played, str(error))
            raise
        seat.leave(self.played, 'stopped' if self.stopped() else '')
        if self.played:
            self.get_logger().info(seat.comparison())
            if self._times is not None:
                now, then = _latency(seat.latencies), _latency(self._times.latencies)
                self.get_logger().info(f'command latency p50/p99/max {now}, recorded {then}')

    def flush(self) -> None:
        """Wait until all readers have all messages, at most two seconds."""
        for publisher in self._outlets.values():
            publisher.wait_for_all_acked(Duration(seconds=2.0))

    def _play_once(self, seat: ControllerSeat | None) -> None:
        self._wall = None
        own = self.reader.own  # a bag of another recorder may begin late and lack clocks
        previous = self._first - 1 if own else None
        for tick, messages in self._from_start():
            previous = tick - 1 if previous is None else previous
            if not own and self.reader.topics[CLOCK].due(tick):
                messages[CLOCK] = messages[CLOCK] or self._clock_message(tick)
            if not self._publish(tick, tick - previous, messages, seat):
                return
            previous = tick
            self.played += 1
            if self.played % _UNACKED == 0:
                self.flush()
        if self.reader.damage is not None:
            raise self.reader.damage

    def _publish(
        self, tick: int, after: int, messages: Sequence[bytes | None], seat: ControllerSeat | None
    ) -> bool:
        """Publish a tick, ``after`` so many others, when it is due; False if stopped before."""
        begin, arrival = (None, None) if self._times is None else self._times.of(messages)
        self._wait(begin, after * self.timeline.period_ns * 1e-9)
        if self.stopped():
            return False
        timed = self._times is not None
        later = self._times.torque if self._times is not None and seat is None else None
        if seat is not None and timed:
            seat.begin(tick)
        for index, data in enumerate(messages):
            if data is not None and index in self._outlets and index != later:
                self._outlets[index].publish(data)
        if seat is not None:
            seat.hear(messages[COMMAND]) if timed else seat.answer(tick, messages[COMMAND])
        elif arrival is not None and later in self._outlets:
            if not self._pace.paused:
                self._wait(arrival, 0.0)
            self._outlets[later].publish(messages[later])
        return not self.stopped()

    def _wait(self, wall: float | None, seconds: float) -> None:
        """Wait until the recorded time ``wall``, s, or ``seconds`` where there is none."""
        if wall is not None:
            seconds = 0.0 if self._wall is None else max(0.0, wall - self._wall)
            self._wall = wall if self._wall is None else max(wall, self._wall)
        self._pace.wait(seconds)

    def _clock_message(self, tick: int) -> bytes:
        return self.reader.topics[CLOCK].codec.encode(self.timeline.stamp_ns(tick))

    def _from_start(self) -> Iterator[tuple[int, list[bytes | None]]]:
        for tick, messages in self.reader.ticks():
            if tick > self._last:
                return
            if tick >= self._first:
                yield tick, messages

    def _wait_for_subscribers(self) -> None:
        deadline = time.monotonic() + self.options.delay
        while not self.stopped() and (left := deadline - time.monotonic()) > 0.0:
            time.sleep(min(left, 0.05))


def _latency(seconds: Sequence[float]) -> str:
    found = spread(np.array(seconds))
    numbers = ['-' if value is None else f'{value:.3g}' for value in found.values()]
    return f'{"/".join(numbers)} ms'


def _answer(response: Any, text: str, success: bool = True) -> Any:
    response.success, response.message = success, text
    return response


def play(argv: list[str]) -> int:
    """
    Run the player with a ROS command line.

    Returns 0 when done; 1 if the bag is damaged or the controller did not answer; 2 for
    bad usage, before anything is published; 130, 143 or 129 after a signal.
    """
    try:
        start('player', argv)
    except ValueError as error:
        return _complain(error, 2)
    executor = SingleThreadedExecutor()
    services = threading.Thread(target=_serve, args=(executor,), daemon=True)
    node = None
    try:
        try:
            node = PlayerNode(argv)
        except (BagError, PlayerError, scenario.ScenarioError) as error:
            return _complain(error, 2)
        _catch_signals(node)
        executor.add_node(node)
        services.start()
        try:
            node.play()
        except (BagError, RunFailed) as error:
            return _complain(f'after {node.played} ticks: {error}', 1)
        if node.stop_signal:
            return 128 + node.stop_signal
        node.flush()
        node.get_logger().info(f'played {node.played} ticks of {node.reader.path}')
        for text in (*node.reader.gaps, *node.reader.notes):
            node.get_logger().info(text)
        return 0
    finally:
        with shutdown_limit():
            executor.shutdown(timeout_sec=1.0)
            if services.ident is not None:
                services.join(timeout=2.0)
            if node is not None:
                node.destroy_node()
            rclpy.try_shutdown()


def _complain(error: object, status: int) -> int:
    print(f'player: {error}', file=sys.stderr)
    return status


def _catch_signals(node: PlayerNode) -> None:
    """End the replay in order on SIGINT, SIGTERM and SIGHUP."""

    def caught(signum: int, _frame: Any) -> None:
        node.stop_signal = signum

    handle_ending(caught)


def _serve(executor: SingleThreadedExecutor) -> None:
    with suppress(ExternalShutdownException):
        executor.spin()
