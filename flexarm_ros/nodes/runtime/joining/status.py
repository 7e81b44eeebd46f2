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
Status messages of the participants of a run: role, phase, parameters, failure.

Every node publishes a latched ``diagnostic_msgs/DiagnosticStatus`` on ``lockstep/status``
whenever its phase changes: ``name`` is its role, ``hardware_id`` an identity drawn at its start
(identities sort by start time), ``message`` one line of text, and the values carry the phase, the
node's full name and, as JSON, the parameters of its section.  From these each node derives the
same scenario; there is no master.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
import math
import time
from typing import Any
import uuid

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from flexarm_ros.nodes.runtime.process.middleware import gid_prefix, source_of
from flexarm_ros.nodes.runtime.topics.endpoints import HOT, NO_OVERRIDES
from flexarm_ros.nodes.runtime.topics.identity import gid_of, node_of, sender_of, SenderInfo
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

TOPIC, TYPE = 'lockstep/status', 'diagnostic_msgs/msg/DiagnosticStatus'
_QOS = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
_READ_QOS = QoSProfile(
    depth=100,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)


_MOST_VALUES, _MOST_IDENTITY = 50, 100
_MOST_MESSAGES = 200
"""Messages read per poll, so that a flood of them does not keep a node from its work."""

_REMIND_S = 1.0

EPOCH, PLANT, PACE, PRIORITY, HEARD = 'epoch', 'plant', 'pace_s', 'priority', 'heard'
"""
Keys of further values: number of the run in this graph, identity of the plant, the plant's wall
time per tick (s), the SCHED_FIFO priority that it requests for a free-running run (0: none), and
the identities of the participants known to a failed one.
"""

_LARGEST, _LONGEST_S = 2**62, 1e12
MOST_PRIORITY = 99


class Phase(str, Enum):
    """The phase of a participant."""

    JOINING = 'joining'
    READY = 'ready'
    RUNNING = 'running'
    PAUSED = 'paused'
    RESETTING = 'resetting'
    DONE = 'done'
    FAILED = 'failed'
    REFUSED = 'refused'

    @property
    def over(self) -> bool:
        """Whether the participant has left the run."""
        return self in (Phase.DONE, Phase.FAILED, Phase.REFUSED)


GOING = (Phase.RUNNING, Phase.PAUSED)
"""Phases of a run that has begun and has not ended."""


@dataclass(frozen=True)
class Status:
    """The status of one participant."""

    role: str
    identity: str
    node: str
    phase: Phase
    text: str = ''
    parameters: str = ''
    last_tick: int = -1
    """Last tick of the run, from the plant once it knows; -1 before."""
    blame: str = ''
    """Role that a failed participant blames."""
    extra: dict[str, str] = field(default_factory=dict)

    def to_message(self) -> DiagnosticStatus:
        """Return the ROS message of this status."""
        bad = self.phase in (Phase.FAILED, Phase.REFUSED)
        pairs = {
            'phase': self.phase.value,
            'node': self.node,
            'last_tick': str(self.last_tick),
            'blame': self.blame,
            'parameters': self.parameters,
            **self.extra,
        }
        return DiagnosticStatus(
            level=DiagnosticStatus.ERROR if bad else DiagnosticStatus.OK,
            name=self.role,
            message=self.text or self.phase.value,
            hardware_id=self.identity,
            values=[KeyValue(key=key, value=value) for key, value in pairs.items()],
        )

    @classmethod
    def from_message(cls, message: DiagnosticStatus) -> Status | None:
        """Return the status in a message, None if it is not a valid participant status."""
        values = {pair.key: pair.value for pair in message.values[:_MOST_VALUES]}
        try:
            _check_numbers(values)
            return cls(
                role=message.name,
                identity=message.hardware_id,
                node=printable(values.pop('node')),
                phase=Phase(values.pop('phase')),
                text=printable(message.message),
                parameters=values.pop('parameters'),
                last_tick=_whole(values.pop('last_tick'), -1),
                blame=printable(values.pop('blame')),
                extra=values,
            )
        except (KeyError, ValueError):
            return None


def _check_numbers(values: Mapping[str, str]) -> None:
    """Raise ValueError if a value that is used as a number is none."""
    _whole(values.get(EPOCH, '0'), 0)
    if not 0.0 <= float(values.get(PACE, '0')) <= _LONGEST_S:
        raise ValueError
    if _whole(values.get(PRIORITY, '0'), 0) > MOST_PRIORITY:
        raise ValueError


def _whole(text: str, least: int) -> int:
    """Return the integer in ``text``; ValueError if it is none or out of range."""
    number = int(text)
    if not least <= number <= _LARGEST:
        raise ValueError
    return number


def printable(text: str, longest: int = 500) -> str:
    """Return text from the network as one line without control characters, for logs."""
    return ''.join(c if c.isprintable() else '?' for c in text[:longest])


def heard_by(status: Status) -> list[str]:
    """Return the identities of the participants known to a failed one."""
    return status.extra.get(HEARD, '').split(',')


def epoch_of(status: Status | None) -> int:
    """Return the number of the run that a participant takes part in."""
    return int(status.extra.get(EPOCH, '0')) if status is not None else 0


def plant_of(status: Status) -> str:
    """Return the identity of a participant's plant; empty while it joins."""
    return status.extra.get(PLANT, '')


class StatusBoard:
    """The statuses of all participants, as received by one node."""

    def __init__(self, node: Node, role: str) -> None:
        self._node = node
        identity = f'{time.time_ns():020d}-{uuid.uuid4().hex}'
        self.mine = Status(role, identity, node.get_fully_qualified_name(), Phase.JOINING)
        self.going = False
        """Whether this node takes part in a run that has begun and has not ended."""
        self.others: dict[str, Status] = {}
        self.sender_info: SenderInfo | None = None
        """How messages identify their publisher; None until the own status has arrived."""
        self._senders: dict[str, bytes] = {}
        self._sources: dict[str, bytes] = {}
        self._seen: set[str] = set()
        self.newcomers = 0
        self._told = -math.inf
        self._publisher = node.create_publisher(
            DiagnosticStatus, TOPIC, _QOS, qos_overriding_options=NO_OVERRIDES
        )
        self._subscription = node.create_subscription(
            DiagnosticStatus, TOPIC, lambda _: None, _READ_QOS, callback_group=HOT
        )
        self.handle = self._subscription.handle
        self.read_qos = _READ_QOS

    def heard(self) -> dict[str, str]:
        """Return the further values of the status of this node after a failure."""
        known = (s.identity for s in self.others.values() if len(s.identity) < _MOST_IDENTITY)
        return {**self.mine.extra, HEARD: ','.join(list(known)[:_MOST_VALUES])}

    def publish(self, **changes: object) -> None:
        """Change the status of this node and publish it."""
        self.mine = replace(self.mine, **changes)  # type: ignore[arg-type]
        self.going = self.mine.phase in GOING
        self._told = time.monotonic()
        self._publisher.publish(self.mine.to_message())

    def remind(self, now: float) -> None:
        """Publish the status again after a second, for peers that have missed it."""
        if now - self._told > _REMIND_S:
            self.publish()

    def update(self) -> None:
        """Read the statuses that have arrived."""
        for _ in range(_MOST_MESSAGES):
            taken = self._subscription.handle.take_message(DiagnosticStatus, False)
            if taken is None:
                break
            status = Status.from_message(taken[0])
            if status is None:
                continue
            sender = sender_of(taken[1])
            if self._senders.setdefault(status.identity, sender) != sender:
                continue  # another publisher uses this identity
            if status.identity == self.mine.identity:
                continue
            self.newcomers += status.identity not in self.others
            self.others[status.identity] = status
        if self.sender_info is None and self.mine.identity in self._senders:
            self._measure(self._senders[self.mine.identity])

    def _measure(self, sender: bytes) -> None:
        """Find out from the own status how messages identify their publisher."""
        own = {gid_of(e) for e in self._publishers() if node_of(e) == self.mine.node}
        if not sender:
            self.sender_info = SenderInfo.NONE
        elif own:
            self.sender_info = SenderInfo.GID if sender in own else SenderInfo.HANDLE

    def forget_the_gone(self) -> None:
        """
        Drop participants whose status publisher was in the graph and has left it.

        A message may come before the graph shows its publisher.
        """
        alive = {source_of(endpoint) for endpoint in self._publishers()}
        for status in list(self.others.values()):
            source, identity = self.source(status), status.identity
            if source in alive:
                self._seen.add(identity)
            elif identity in self._seen:
                del self.others[identity], self._senders[identity]
                self._sources.pop(identity, None)

    def silent(self) -> set[bytes]:
        """Return the sources with more status publishers in the graph than received statuses."""
        shown = Counter(source_of(endpoint) for endpoint in self._publishers())
        heard = Counter(self.source(status) for status in (self.mine, *self.others.values()))
        return set(shown - heard)

    def _publishers(self) -> list[Any]:
        """Return the endpoints of all status publishers in the graph, this node's included."""
        return list(self._node.get_publishers_info_by_topic(self._publisher.topic_name))

    def source(self, status: Status) -> bytes:
        """
        Return the source (`middleware.source_of`) of the node that published ``status``.

        Empty while it is unknown: without the GID in messages the source is found by the node's
        name, which two nodes may share.
        """
        found = self._sources.get(status.identity, b'') or self._find_source(status)
        if found:
            self._sources[status.identity] = found
        return found

    def _find_source(self, status: Status) -> bytes:
        length = gid_prefix()
        if not length:
            return status.node.encode()
        if self.sender_info is SenderInfo.GID:
            return self._senders[status.identity][:length]
        shown = (e for e in self._publishers() if node_of(e) == status.node)
        free = Counter(source_of(endpoint) for endpoint in shown)
        heard = (s for s in (self.mine, *self.others.values()) if s.node == status.node)
        free.subtract(self._sources.get(s.identity, b'') for s in heard)
        found = [source for source, count in free.items() if count > 0]
        return found[0] if len(found) == 1 else b''

    def writers(self) -> set[bytes]:
        """Return the sources of all nodes that publish, or have published, a status."""
        return {source_of(endpoint) for endpoint in self._publishers()} | {
            self.source(status) for status in self.others.values()
        }

    def of(self, role: str) -> list[Status]:
        """Return the statuses of the other nodes that hold ``role`` and take part."""
        return [s for s in self.others.values() if s.role == role and s.phase is not Phase.REFUSED]

    def flush(self, timeout_s: float) -> None:
        """Wait until every reader has the last status of this node, at most ``timeout_s``."""
        from rclpy.duration import Duration

        self._publisher.wait_for_all_acked(Duration(seconds=timeout_s))
