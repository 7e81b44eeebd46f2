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
The floor: the same nodes, topics, types and sizes in lock-step, with empty callbacks.

``python -m bench.floor ROLE TICKS MODE`` is one process of it.  ``MODE``:

``raw``        one rclpy wait set, serialized bytes made beforehand, nothing decoded or checked
``executor``   rclpy as its tutorials have it: SingleThreadedExecutor, message objects, callbacks

As in the real run, references go out ahead of time in batches and the recorder wakes every
20 ms and empties its queues; it writes nothing.  A process says ``ready`` on standard output when
all its endpoints are connected, begins when it reads a line, and prints its costs as JSON.
"""

from __future__ import annotations

from collections.abc import Callable
import json
import os
import sys
import time
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.core.run.parts import parts_of
from flexarm_ros.nodes.runtime.topics.endpoints import HOT, NO_OVERRIDES, Waiter
from flexarm_ros.nodes.runtime.topics.graph import (
    message_class,
    qos_profile,
    readers,
    reads,
    TICK_EVERY,
    TICK_TOPIC,
)
from flexarm_ros.nodes.trajectory import ahead_until
from flexarm_ros.wire.topics import per_tick_topics, Topic
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from std_msgs.msg import UInt64

CONFIG = scenario.load('fls_tip')
_RECORDER_NAP_NS = 20_000_000
_LIMIT_S = 60.0
_SILENCE_S = 5.0
"""Nothing holds this plant up: a recorder that is kept from running loses messages."""


class Skeleton(Node):
    """The endpoints of one role, and how many messages have come on each."""

    def __init__(self, role: str, ticks: int, executor: bool) -> None:
        super().__init__(role)
        self.ticks = ticks
        self.publish: dict[str, Callable[[], None]] = {}
        self.handles: dict[str, Any] = {}
        self.types: dict[str, Any] = {}
        self.count: dict[str, int] = {}
        self.moved: Callable[[], None] = lambda: None
        self._endpoints: list[tuple[Callable[[], int], int]] = []
        for topic in per_tick_topics(CONFIG):
            if topic.node == role:
                self._add_output(topic, executor)
            elif reads(role, topic, CONFIG):
                self._add_input(topic, executor)
        if role == 'plant':
            self.reached = self.create_publisher(UInt64, TICK_TOPIC, 1)
            self._endpoints.append((self.reached.get_subscription_count, 1))
        if role == 'trajectory':
            took = self.create_subscription(
                UInt64, TICK_TOPIC, self._at_tick, 1, callback_group=None if executor else HOT
            )
            self.handles[TICK_TOPIC], self.types[TICK_TOPIC] = took.handle, UInt64
        self.plant_tick = 0

    def _add_output(self, topic: Topic, executor: bool) -> None:
        kind = message_class(topic.type_name)
        publisher = self.create_publisher(
            kind, topic.name, qos_profile(topic.qos), qos_overriding_options=NO_OVERRIDES
        )
        data = topic.codec.encode(1, *(0.5,) * len(topic.codec.fields))
        message = deserialize_message(data, kind) if executor else data
        self.publish[topic.name] = lambda: publisher.publish(message)
        self._endpoints.append(
            (publisher.get_subscription_count, len(readers(topic.name, CONFIG)))
        )

    def _add_input(self, topic: Topic, executor: bool) -> None:
        kind = message_class(topic.type_name)
        self.count[topic.name] = 0

        def called(_: Any) -> None:
            self.count[topic.name] += 1
            self.moved()

        subscription = self.create_subscription(
            kind, topic.name, called, qos_profile(topic.qos), raw=not executor,
            callback_group=None if executor else HOT, qos_overriding_options=NO_OVERRIDES,
        )  # fmt: skip
        self.handles[topic.name], self.types[topic.name] = subscription.handle, kind
        self._endpoints.append((subscription.handle.get_publisher_count, 1))

    def _at_tick(self, message: UInt64) -> None:
        self.plant_tick = message.data
        self.moved()

    def connected(self) -> bool:
        """Whether every endpoint has its peers."""
        return all(count() >= wanted for count, wanted in self._endpoints)

    def take(self, name: str) -> bool:
        """Take one message of a topic; False where there is none."""
        if self.handles[name].take_message(self.types[name], True) is None:
            return False
        self.count[name] += 1
        return True


INPUTS = {part.NAME: part.reads(CONFIG) for part in parts_of(CONFIG)}
"""What a role waits for at each tick, the last to come first."""


def raw(node: Skeleton, role: str) -> None:
    """Drive a role over one wait set, with serialized bytes."""
    waiter = Waiter(node.context)
    if role == 'recorder':
        _record(node, waiter)
    elif role == 'trajectory':
        _refer(node, waiter)
    else:
        for tick in range(node.ticks):
            if role == 'plant':
                _begin(node, tick)
            # The first input is the last to come: a take before it is here would fail every time.
            waiter.wait([node.handles[INPUTS[role][0]]], int(_LIMIT_S * 1e9))
            for name in INPUTS[role]:
                while node.count[name] <= tick:
                    if not node.take(name):
                        waiter.wait([node.handles[name]], int(_LIMIT_S * 1e9))
            if role != 'plant':
                next(iter(node.publish.values()))()


def _begin(node: Skeleton, tick: int) -> None:
    """Publish what a plant does at the start of a tick."""
    if tick % TICK_EVERY == 0:
        node.reached.publish(UInt64(data=tick))
    node.publish['plant/state']()
    node.publish['/clock']()


def _record(node: Skeleton, waiter: Waiter) -> None:
    """Empty every queue, sleep, and so on until all ticks are here."""
    last = time.monotonic()
    while min(node.count.values()) < node.ticks:
        for name in node.count:
            while node.take(name):
                last = time.monotonic()
        if time.monotonic() - last > _SILENCE_S:
            raise SystemExit('recorder: a message is lost')
        waiter.wait([], _RECORDER_NAP_NS)


def _refer(node: Skeleton, waiter: Waiter) -> None:
    """Publish references ahead of the plant."""
    (publish,) = node.publish.values()
    done, reached = 0, 0
    while True:
        until = ahead_until(reached, done, node.ticks)
        for _ in range(done, until):
            publish()
        done = until
        if done == node.ticks:
            return
        taken = node.handles[TICK_TOPIC].take_message(UInt64, False)
        if taken is None:
            waiter.wait([node.handles[TICK_TOPIC]], int(_LIMIT_S * 1e9))
        else:
            reached = taken[0].data


def by_executor(node: Skeleton, role: str, executor: SingleThreadedExecutor) -> None:
    """Drive a role by callbacks of an executor."""
    state = {'tick': 0, 'sent': False, 'done': 0}

    def moved() -> None:
        if role == 'trajectory':
            until = ahead_until(node.plant_tick, state['done'], node.ticks)
            for _ in range(state['done'], until):
                node.publish['reference']()
            state['tick'] = state['done'] = until
            return
        while state['tick'] < node.ticks:
            if role == 'plant' and not state['sent']:
                _begin(node, state['tick'])
                state['sent'] = True
            if min(node.count.values()) <= state['tick']:
                return
            if role not in ('plant', 'recorder'):
                next(iter(node.publish.values()))()
            state['sent'] = False
            state['tick'] += 1

    node.moved = moved
    moved()
    deadline = time.monotonic() + _LIMIT_S
    while state['tick'] < node.ticks and time.monotonic() < deadline:
        executor.spin_once(timeout_sec=1.0)


def main(role: str, ticks: int, mode: str) -> int:
    """Run one process of the floor."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    rclpy.init(args=[])
    node = Skeleton(role, ticks, mode == 'executor')
    executor = SingleThreadedExecutor()
    if mode == 'executor':
        executor.add_node(node)
    deadline = time.monotonic() + _LIMIT_S
    while not node.connected():
        if time.monotonic() > deadline:
            return 1
        time.sleep(0.02)
    print('ready', flush=True)
    sys.stdin.readline()
    start, cpu = time.monotonic(), time.process_time()
    if mode == 'executor':
        by_executor(node, role, executor)
    else:
        raw(node, role)
    wall, cpu = time.monotonic() - start, time.process_time() - cpu
    print(json.dumps({'role': role, 'wall_s': wall, 'cpu_s': cpu, 'ticks': ticks}), flush=True)
    sys.stdin.readline()  # leave together: a publisher that goes takes its last messages along
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1], int(sys.argv[2]), sys.argv[3]))
