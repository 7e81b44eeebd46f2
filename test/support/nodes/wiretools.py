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
One node against a wire full of rubbish: the test plays every other node of its run.

`Peers` holds the seats of all other roles from one DDS participant, as the player does for the
controller, and knows from a simulation which bytes belong to each tick.
"""

from __future__ import annotations

from collections.abc import Callable
import os
from pathlib import Path
import subprocess
import time
from typing import Any

from bagtools import small_messages
from diagnostic_msgs.msg import DiagnosticStatus
from flexarm_ros import scenario
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.parts import roles
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.nodes.answering import answering_node
from flexarm_ros.nodes.runtime.joining import status
from flexarm_ros.nodes.runtime.joining.config_exchange import dump_sections
from flexarm_ros.nodes.runtime.joining.status import Phase, StatusBoard
from flexarm_ros.nodes.runtime.process.supervisor import Supervisor
from flexarm_ros.nodes.runtime.topics.endpoints import NO_OVERRIDES, Waiter
from flexarm_ros.nodes.runtime.topics.graph import message_class, qos_profile, reads
from flexarm_ros.wire.topics import per_tick_topics, Topic
from nodetools import start_node, wait_for
import rclpy

PATIENCE_S = 60.0


class Wire:
    """A DDS participant of the test, with publishers of raw bytes."""

    def __init__(self, name: str) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=int(os.environ['ROS_DOMAIN_ID']))
        self.node = rclpy.create_node(name, context=self.context, start_parameter_services=False)
        self._publishers: dict[str, Any] = {}

    def publisher(self, name: str, kind: Any, qos: Any) -> Any:
        """Return the publisher of ``name``, made at its first use."""
        if name not in self._publishers:
            self._publishers[name] = self.node.create_publisher(
                kind, name, qos, qos_overriding_options=NO_OVERRIDES
            )
        return self._publishers[name]

    def close(self) -> None:
        """Leave the graph."""
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


class Peers(Wire):
    """All roles but one."""

    def __init__(self, role: str, config: RunConfig) -> None:
        super().__init__('peers')
        self.role, self.config = role, config
        self.topics = per_tick_topics(config)
        self.timeline = Timeline.of(config.run)
        self.boards = {r: StatusBoard(self.node, r) for r in roles(config) if r != role}
        for name, board in self.boards.items():
            board.publish(parameters=dump_sections(config, name))
        self.inputs = [t for t in self.topics if reads(role, t, config)]
        self.output = [t for t in self.topics if t.node == role]
        for topic in self.topics:
            if topic.node != role:
                self.publisher(topic.name, message_class(topic.type_name), qos_profile(topic.qos))
        self.heard = {
            topic.name: self.node.create_subscription(
                message_class(topic.type_name), topic.name, lambda _: None, qos_profile(topic.qos),
                raw=True, qos_overriding_options=NO_OVERRIDES,
            )
            for topic in self.output
        }  # fmt: skip
        self._waiter = Waiter(self.context)

    def right(self, topic: Topic, tick: int) -> bytes:
        """Return the bytes that belong on ``topic`` at ``tick``."""
        return small_messages(self.config)[tick][self.topics.index(topic)]

    def send(self, topic: Topic, data: bytes) -> None:
        """Publish bytes."""
        self.publisher(topic.name, None, None).publish(data)

    def hear(
        self, topic: Topic, node: subprocess.Popen[str], repeat: Callable[[], None] = lambda: None
    ) -> bytes:
        """Wait for the node's next message; ``repeat`` what is repeated every 0.1 s meanwhile."""
        handle = self.heard[topic.name].handle
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            taken = handle.take_message(message_class(topic.type_name), True)
            if taken is not None:
                return bytes(taken[0])
            assert node.poll() is None, f'the node has ended:\n{node.communicate()[0]}'
            self.wait_for(handle)
            repeat()
        raise AssertionError(f'no message on {topic.name} within {PATIENCE_S:g} s')

    def wait_for(self, handle: Any) -> None:
        """Wait until there may be a message, 0.1 s at the longest."""
        self._waiter.wait([handle], 100_000_000)

    def wait_until(self, node: subprocess.Popen[str], done: Callable[[], bool], what: str) -> None:
        """Look at the node's status until ``done``."""
        board = next(iter(self.boards.values()))
        deadline = time.monotonic() + PATIENCE_S
        while not done():
            board.update()
            assert node.poll() is None, f'the node has ended:\n{node.communicate()[0]}'
            assert time.monotonic() < deadline, what
            self._waiter.wait([board.handle], 50_000_000)

    def phase(self) -> Phase | None:
        """Return the phase that the node under test tells."""
        held = next(iter(self.boards.values())).of(self.role)
        return held[0].phase if held else None

    def _connected(self) -> bool:
        """Whether each input of the node has our publisher, and each output our reader."""
        return all(
            self.publisher(topic.name, None, None).get_subscription_count()
            for topic in self.inputs
        ) and all(heard.handle.get_publisher_count() for heard in self.heard.values())

    def begin(self, node: subprocess.Popen[str]) -> None:
        """Wait until the node runs; the plant's seat then says that it does too."""
        self.wait_until(node, self._connected, 'connected')
        for board in self.boards.values():
            board.publish(phase=Phase.READY)
        self.wait_until(node, lambda: self.phase() in (Phase.READY, Phase.RUNNING), 'ready')
        if self.role != 'plant':
            self.boards['plant'].publish(phase=Phase.RUNNING)
        self.wait_until(node, lambda: self.phase() is Phase.RUNNING, 'running')

    def end(self, ticks: int) -> None:
        """Say that the run is over."""
        for board in self.boards.values():
            board.publish(phase=Phase.DONE, last_tick=ticks - 1)


def fly_against(role: str, file: Path, *words: str) -> tuple[Peers, subprocess.Popen[str]]:
    """Start the node ``role`` and the test's peers, and wait until both are running."""
    config = scenario.load(str(file), [])
    peers = Peers(role, config)
    node = start_node(role, file, *words)
    try:
        peers.begin(node)
    except BaseException:
        node.kill()
        node.wait()
        peers.close()
        raise
    return peers, node


class Joining:
    """A controller before its run, the other nodes, and a first controller still unheard of."""

    def __init__(self, file: Path) -> None:
        words = ['--ros-args', '--params-file', str(file)]
        self.config = scenario.load(str(file), [])
        self.peers = Peers('controller', self.config)
        self.first = Wire('first')
        self.word = self.first.publisher(status.TOPIC, DiagnosticStatus, status._QOS)
        self.context = rclpy.Context()
        rclpy.init(args=words, context=self.context)
        self.second = answering_node('controller')(words, Supervisor(), context=self.context)
        others = len(roles(self.config))  # the five others and the first controller
        topic = self.second.resolve_topic_name(status.TOPIC)
        wait_for(lambda: self.second.count_publishers(topic) > others, 60, 'all seen')
        self.hear(len(roles(self.config)) - 1)

    def hear(self, count: int) -> None:
        """Take statuses until those of ``count`` others are here."""
        board = self.second.board

        def taken() -> bool:
            board.update()
            return len(board.others) == count and board.sender_info is not None

        wait_for(taken, 60, f'{count} others heard')

    def introduce(self, identity: str) -> None:
        """Let the first controller say who it is."""
        texts = dump_sections(self.config, 'controller')
        known = status.Status('controller', identity, '/first', Phase.READY, parameters=texts)
        self.word.publish(known.to_message())

    def close(self) -> None:
        """Leave the graph."""
        self.second.destroy_node()
        rclpy.shutdown(context=self.context)
        self.first.close()
        self.peers.close()
