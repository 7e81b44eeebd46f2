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

"""A recorded run in place of the plant and the sensors, for a controller under test."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import time

from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.parts import roles
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.nodes.realtime.command import arrival
from flexarm_ros.nodes.runtime.errors import RunFailed
from flexarm_ros.nodes.runtime.joining.compatibility import publisher_fault, subscriber_faults
from flexarm_ros.nodes.runtime.joining.config_exchange import dump_sections
from flexarm_ros.nodes.runtime.joining.status import Phase, StatusBoard
from flexarm_ros.nodes.runtime.process.middleware import source_of
from flexarm_ros.nodes.runtime.topics.endpoints import HOT, NO_OVERRIDES, Waiter
from flexarm_ros.nodes.runtime.topics.graph import message_class, qos_profile
from flexarm_ros.nodes.runtime.topics.identity import UNKNOWN_NODE
from flexarm_ros.wire.topics import COMMAND, per_tick_topics, Topic
from rclpy.node import Node
from rclpy.publisher import Publisher

_EXTERNAL_GRACE_S = 1.0
_QUIET_S = 1.0
"""Wall time, s, without a torque after which the controller counts as finished."""


class ControllerSeat:
    """
    The controller's side of a replay: waits for the controller and for its torques.

    The player takes every other role of the run, so that a controller node of this package
    joins as in a live run; any other node that publishes ``joint_command`` works as well.
    """

    def __init__(
        self, node: Node, outlets: Sequence[tuple[Topic, Publisher]], config: RunConfig,
        timeline: Timeline, limit_s: float, stopped: Callable[[], bool],
    ) -> None:  # fmt: skip
        self._node, self._outlets, self._timeline = node, outlets, timeline
        self._limit, self._stopped = limit_s, stopped
        self._topic = per_tick_topics(config)[COMMAND]
        self._kind = message_class(self._topic.type_name)
        self._subscription = node.create_subscription(
            self._kind, self._topic.name, lambda _: None, qos_profile(self._topic.qos),
            callback_group=HOT, raw=True, qos_overriding_options=NO_OVERRIDES,
        )  # fmt: skip
        self._waiter = Waiter(node.context)
        self._boards = {
            role: StatusBoard(node, role) for role in roles(config) if role != 'controller'
        }
        for role, board in self._boards.items():
            board.publish(parameters=dump_sections(config, role), phase=Phase.READY)
        self._largest = 0.0
        self._equal = self._answered = 0
        self._begun: dict[int, float] = {}
        self._held: dict[int, tuple[float, ...]] = {}
        self._heard: dict[int, tuple[float, ...]] = {}
        self._compared: set[int] = set()
        self.latencies: list[float] = []
        """Time from a tick's publication to the arrival of its torque, s; without a barrier."""

    def wait_for_controller(self) -> None:
        """Wait for a controller to connect or the player to stop; RunFailed after a minute."""
        deadline = time.monotonic() + 60.0
        board, seen = self._boards['plant'], 0.0
        while time.monotonic() < deadline:
            if self._stopped():
                return
            board.update()
            held = [s for s in board.of('controller') if not s.phase.over]
            if any(s.phase in (Phase.READY, Phase.RUNNING) for s in held):
                break
            publishers = self._subscription.handle.get_publisher_count()
            fault = self._fault()
            if fault and UNKNOWN_NODE not in fault:
                raise RunFailed('controller', fault)
            seen = (seen or time.monotonic()) if publishers and not held else 0.0
            if seen and time.monotonic() - seen > _EXTERNAL_GRACE_S:
                self._topic.codec.prepare_any()
                break
            time.sleep(0.02)
        else:
            raise RunFailed('controller', 'no controller joined within 60 s')
        board.publish(phase=Phase.RUNNING)

    def _fault(self) -> str:
        """Return why controller and player can never be connected, empty if they can."""
        node, topic = self._node, self._topic
        fault = publisher_fault(node, topic.name, topic.type_name, self._subscription.qos_profile)
        name = node.resolve_topic_name(topic.name)
        senders = {source_of(e) for e in node.get_publishers_info_by_topic(name)}
        deaf = (
            found
            for topic, publisher in self._outlets
            for e, found in subscriber_faults(
                node, topic.name, topic.type_name, publisher.qos_profile
            )
            if source_of(e) in senders
        )
        return fault or next(deaf, '')

    def answer(self, tick: int, recorded: bytes | None) -> None:
        """Wait for the torque of ``tick`` and compare it with the recorded one."""
        stamp, other = self._timeline.stamp_ns(tick), ''
        deadline = time.monotonic() + self._limit
        while (left := deadline - time.monotonic()) > 0.0 and not self._stopped():
            taken = self._subscription.handle.take_message(self._kind, True)
            if taken is None:
                self._waiter.wait([self._subscription.handle], int(min(left, 0.1) * 1e9))
                continue
            try:
                came, torque = self._topic.codec.decode_any(taken[0])
            except ValueError as error:
                raise RunFailed(
                    'controller', f'tick {tick}: {self._topic.name}: {error}'
                ) from None
            if came == stamp:
                self._answered += 1
                answers, held = self._topic.codec.decode_any(recorded) if recorded else (0, None)
                # Of a free-running run it may be held from an earlier tick.
                self._compare(stamp, torque, held if answers == stamp else None)
                return
            other = f'; one with stamp {came} ns arrived, expected {stamp} ns'
        if not self._stopped():
            raise RunFailed(
                'controller', f'tick {tick}: no joint_command within {self._limit:g} s{other}'
            )

    # --- by the wall clock, without a barrier ------------------------------------------

    def begin(self, tick: int) -> None:
        """Note that ``tick`` is published now."""
        self._begun[self._timeline.stamp_ns(tick)] = time.monotonic()

    def hear(self, recorded: bytes | None = None) -> None:
        """Read the torques that have arrived; ``recorded``: the one held over the last tick."""
        if recorded is not None:
            stamp, held = self._topic.codec.decode_any(recorded)
            self._compare(stamp, self._heard.get(stamp), self._held.setdefault(stamp, held))
        while (taken := self._subscription.handle.take_message(self._kind, True)) is not None:
            now = time.monotonic()
            try:
                stamp, torque = self._topic.codec.decode_any(taken[0])
            except ValueError as error:
                raise RunFailed('controller', f'{self._topic.name}: {error}') from None
            begun = self._begun.get(stamp)
            if begun is not None:
                self._answered += 1
                self.latencies.append(arrival(taken[1], now) - begun)
                self._heard[stamp] = torque
                self._compare(stamp, torque, self._held.get(stamp))

    def hear_last(self) -> None:
        """Wait until all ticks are answered, or no torque has arrived for a second."""
        until = time.monotonic() + min(self._limit, _QUIET_S)
        while len(self.latencies) < len(self._begun) and not self._stopped():
            left = until - time.monotonic()
            if left <= 0.0:
                return  # it does not answer every tick, and has finished
            before = len(self.latencies)
            self._waiter.wait([self._subscription.handle], int(min(left, 0.1) * 1e9))
            self.hear()
            if len(self.latencies) > before:
                until = time.monotonic() + min(self._limit, _QUIET_S)

    def _compare(
        self, stamp: int, torque: tuple[float, ...] | None, recorded: tuple[float, ...] | None
    ) -> None:
        """Compare the torque that answers ``stamp`` with the recorded one, once both are known."""
        if torque is None or recorded is None or stamp in self._compared:
            return
        self._compared.add(stamp)
        self._equal += torque == recorded
        self._largest = max(
            self._largest, *(abs(a - b) for a, b in zip(torque, recorded, strict=True))
        )

    def comparison(self) -> str:
        """Return one line that compares the torques with the recorded ones."""
        return (
            f'{self._answered} torques, {self._equal} equal to the recorded ones, '
            f'largest difference {self._largest:.6g} N m'
        )

    def leave(self, ticks: int, problem: str = '') -> None:
        """Tell the controller that the run is over, and the reason if it broke off."""
        phase = Phase.FAILED if problem else Phase.DONE
        for board in self._boards.values():
            board.publish(phase=phase, last_tick=ticks - 1, text=problem)
            board.flush(1.0)
