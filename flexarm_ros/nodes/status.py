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
What the participants of a run tell one another: who is there, and how it goes.

Every node publishes a latched ``diagnostic_msgs/DiagnosticStatus`` on
``lockstep/status`` whenever its phase changes: ``name`` is its role,
``hardware_id`` an identity drawn at its start (it sorts by that time), ``message`` one line for
people, and the values carry the phase, the node's full name and, as YAML, the
parameters of its section.  From these each node works out the same whole
scenario, without a master.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
import time
import uuid

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from flexarm_ros.nodes.endpoints import HOT, NO_OVERRIDES
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

TOPIC = 'lockstep/status'
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


_MOST_VALUES = 50
_MOST_MESSAGES = 200
"""Messages taken at one look: a flood of them must not keep a node from its work."""

EPOCH, PACE = 'epoch', 'pace_s'
"""Keys of further values: the run's number in this graph, and the plant's wall time a tick."""

_LARGEST, _LONGEST_S = 2**62, 1e12


class Phase(str, Enum):
    """Where a participant stands in its run."""

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
        """Whether the participant has left the run, well or badly."""
        return self in (Phase.DONE, Phase.FAILED, Phase.REFUSED)


GOING = (Phase.RUNNING, Phase.PAUSED)
"""Phases of a run that has begun and goes on."""


@dataclass(frozen=True)
class Status:
    """One participant's word about itself."""

    role: str
    identity: str
    node: str
    phase: Phase
    text: str = ''
    parameters: str = ''
    last_tick: int = -1
    """Last tick of the run, from the plant once it knows; -1 before."""
    blame: str = ''
    """Role that a failed participant holds responsible."""
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
        """Return the status in a message, None where it is nobody's of ours."""
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
    """Raise ValueError where what is read as a number later on is none."""
    _whole(values.get(EPOCH, '0'), 0)
    if not 0.0 <= float(values.get(PACE, '0')) <= _LONGEST_S:
        raise ValueError


def _whole(text: str, least: int) -> int:
    """Return the whole number in ``text``; ValueError where it is none, or out of bounds."""
    number = int(text)
    if not least <= number <= _LARGEST:
        raise ValueError
    return number


def printable(text: str, longest: int = 500) -> str:
    """Return a stranger's text as it may stand in a log: one line, no control characters."""
    return ''.join(c if c.isprintable() else '?' for c in text[:longest])


class Board:
    """The statuses of all participants, as one node sees them."""

    def __init__(self, node: Node, role: str) -> None:
        self._node = node
        identity = f'{time.time_ns():020d}-{uuid.uuid4().hex}'
        self.mine = Status(role, identity, node.get_fully_qualified_name(), Phase.JOINING)
        self.going = False
        """Whether this node takes part in a run that has begun and goes on."""
        self.others: dict[str, Status] = {}
        self._gids: dict[str, bytes] = {}
        self._seen: set[str] = set()
        self._spoke: set[bytes] = set()
        self.newcomers = 0
        self._publisher = node.create_publisher(
            DiagnosticStatus, TOPIC, _QOS, qos_overriding_options=NO_OVERRIDES
        )
        self._subscription = node.create_subscription(
            DiagnosticStatus, TOPIC, lambda _: None, _READ_QOS, callback_group=HOT
        )
        self.handle = self._subscription.handle

    def publish(self, **changes: object) -> None:
        """Change this node's own status and tell everybody."""
        self.mine = replace(self.mine, **changes)  # type: ignore[arg-type]
        self.going = self.mine.phase in GOING
        self._publisher.publish(self.mine.to_message())

    def update(self) -> None:
        """Take what has arrived."""
        for _ in range(_MOST_MESSAGES):
            taken = self._subscription.handle.take_message(DiagnosticStatus, False)
            if taken is None:
                break
            status = Status.from_message(taken[0])
            gid = bytes(taken[1].get('publisher_gid', {}).get('data', b''))
            self._spoke.add(gid[:16])
            if status is None or status.identity == self.mine.identity:
                continue
            if status.identity not in self.others:
                self.newcomers += 1
                self._gids[status.identity] = gid
            elif self._gids[status.identity] != gid:
                continue  # somebody speaks in another's name
            self.others[status.identity] = status

    def forget_the_gone(self) -> None:
        """
        Drop participants whose status publisher was in the graph and has left it.

        A message may come before the graph shows its publisher.
        """
        alive = self._publishers()
        for identity, gid in list(self._gids.items()):
            if gid[:16] in alive:
                self._seen.add(identity)
            elif identity in self._seen:
                del self.others[identity], self._gids[identity]

    def silent(self) -> set[bytes]:
        """Return the publishers in the graph (gids) from which no status has come yet."""
        return self._publishers() - self._spoke

    def _publishers(self) -> set[bytes]:
        """Return the gids of all who publish a status, this node included."""
        topic = self._publisher.topic_name
        return {bytes(e.endpoint_gid)[:16] for e in self._node.get_publishers_info_by_topic(topic)}

    def gid(self, status: Status) -> bytes:
        """Return the identity of the publisher that ``status`` came from."""
        return self._gids[status.identity]

    def writers(self) -> set[bytes]:
        """Return the DDS participants (gid prefixes) of all who published a status."""
        return {gid[:12] for gid in (*self._publishers(), *self._gids.values())}

    def of(self, role: str) -> list[Status]:
        """Return the statuses of the other nodes that hold ``role`` and take part."""
        return [s for s in self.others.values() if s.role == role and s.phase is not Phase.REFUSED]

    def flush(self, timeout_s: float) -> None:
        """Wait until every reader has this node's last word, ``timeout_s`` at the longest."""
        from rclpy.duration import Duration

        self._publisher.wait_for_all_acked(Duration(seconds=timeout_s))
