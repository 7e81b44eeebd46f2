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
The per-tick topics of a node: inputs in the order of ticks, outputs as serialized bytes.

Tick k of a run has the stamp ``T0 + k T``.  The wall clock is not used.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
import math
from typing import Any

from flexarm_ros.core.numerics.records import Records
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.nodes.runtime.errors import RunFailed
from flexarm_ros.nodes.runtime.joining.status import printable
from flexarm_ros.nodes.runtime.topics import rcl_ports
from flexarm_ros.nodes.runtime.topics.endpoints import HOT, NO_OVERRIDES
from flexarm_ros.nodes.runtime.topics.graph import message_class, qos_profile
from flexarm_ros.nodes.runtime.topics.identity import gid_of, node_of, SenderInfo
from flexarm_ros.nodes.runtime.topics.rcl_ports import BlockReader, message_of
from flexarm_ros.wire.rcl_calls import EMPTY, READ
from flexarm_ros.wire.topics import Topic
import numpy as np
from rclpy.node import Node

Values = tuple[float, ...]
_FAULT_LENGTH = 200
_MOST_MESSAGES = 2000
"""Messages read per call, so that a flood of invalid ones does not keep a node from polling."""


class Output:
    """One per-tick topic that this node publishes, as serialized bytes."""

    def __init__(self, node: Node, topic: Topic) -> None:
        self.topic = topic
        self.publisher = node.create_publisher(
            message_class(topic.type_name), topic.name, qos_profile(topic.qos),
            qos_overriding_options=NO_OVERRIDES,
        )  # fmt: skip
        self.near: tuple[Input, ...] = ()
        self._heard = True
        self.configure(topic, None)

    def configure(self, topic: Topic, timeline: Timeline | None) -> None:
        """Use the message layout of the agreed scenario."""
        self.topic = topic
        self._encode = topic.codec.encode
        self.publish = self.publisher.handle.publish_raw
        """Publish bytes as they are; the publisher's own method checks their type each time."""

    def send(self, stamp_ns: int, *values: float) -> None:
        """Publish one message with the values in the order of the codec's fields."""
        data = self._encode(stamp_ns, *values)
        for entry in self.near:
            entry.arrived.append((data, stamp_ns, values))
        if self._heard:
            self.publish(data)

    def look(self) -> None:
        """Check for subscriptions besides the inputs of this process, served directly."""
        if self.near:
            self._heard = self.publisher.get_subscription_count() > len(self.near)


class Input:
    """
    One per-tick topic that this node reads, in the order of ticks.

    The middleware's queue is the only queue: a message is read when its tick is due.  If the topic
    does not have a message at each tick (`Topic.every`), ``tick`` and the arguments named so count
    its messages; `whole` counts ticks of the run.
    """

    def __init__(self, node: Node, topic: Topic, reject: Callable[[str, str], None]) -> None:
        self.topic = topic
        self._reject = reject
        self._type = message_class(topic.type_name)
        self.subscription = node.create_subscription(
            self._type, topic.name, lambda _: None, qos_profile(topic.qos),
            callback_group=HOT, raw=True, qos_overriding_options=NO_OVERRIDES,
        )  # fmt: skip
        self.handle = self.subscription.handle
        self._take = self.handle.take_message
        self._returned: deque[tuple[bytes, dict[str, Any]]] = deque()
        """Messages that the fast path has taken and given back, with their infos."""
        self.arrived: deque[tuple[bytes, int, Values]] = deque()
        self._block: BlockReader | None = None
        self.near = False
        """Whether the publisher, in this process, passes messages directly; see `connect`."""
        self.accepted = b''
        """
        Sender (`identity.sender_of`) of this run's publisher of the topic.

        A handle is not shown in the graph: that of the first valid message is used.
        """
        self._sender = b''
        self._unnamed = True
        """Whether messages do not show whether they come from this run's publisher."""
        self.source = topic.node
        self.sender = ''
        """Name of this run's publishing node, once it is known."""
        self._rising = False
        # /clock is shared by all arms of a graph; the other topics belong to one run.
        alone = not topic.name.startswith('/')
        self._unwanted = f"a publisher that is not this run's {topic.node}" if alone else ''
        self.reset()

    def reset(self) -> None:
        """Expect tick 0 next."""
        self.tick = -1
        self.data = b''
        self._sequence: int | None = None
        self._gap = self._jumped = False
        """Gaps in the sequence numbers: since the last valid message, and since the last reset."""
        self.values: Values = ()
        self.arrived.clear()
        self._returned.clear()
        self._last_stamp = -(2**63)

    @property
    def whole(self) -> int:
        """Number of ticks of the run for which every due message has arrived."""
        return (self.tick + 1) * self.topic.every

    def configure(self, topic: Topic, timeline: Timeline) -> None:
        """Use the message layout and the stamps of the agreed scenario."""
        self.topic = topic
        self._decode = topic.codec.decode
        self._block = None
        self._first_ns, self._period_ns = timeline.stamp_ns(0), topic.every * timeline.period_ns
        self._exact = not topic.late

    def drain(self) -> None:
        """Discard the queue and expect tick 0 next."""
        while self._take(self._type, True) is not None:
            pass
        self.reset()

    def fetch(self, tick: int) -> bool:
        """
        Read messages up to that of ``tick``; False if it has not arrived yet.

        Raises RunFailed for an invalid message, unless ``on_invalid`` is ``ignore``.
        """
        if self.tick >= tick:
            return True
        for _ in range(_MOST_MESSAGES):
            if self.near:
                if not self.arrived:
                    return False
                fault = self._judge(*self.arrived.popleft())
            else:
                data = self._next(self.tick + 1)
                if data is None:
                    return False
                fault = self._read(data)
            if fault:
                self._complain(fault)
            elif self.tick >= tick:
                return True
        return False

    def _next(self, tick: int) -> bytes | None:
        """
        Return the next message of this run's publisher, None if there is none.

        Raises RunFailed if a message between the last one and that of ``tick`` is lost.
        """
        for _ in range(_MOST_MESSAGES):
            taken = self._returned.popleft() if self._returned else self._take(self._type, True)
            if taken is None:
                return None
            data: bytes = taken[0]
            info = taken[1]
            if self._ours(info) and self._in_sequence(info, tick):
                return data
            self._complain(self._unwanted)
        return None

    # --- the fast path -------------------------------------------------------------------

    @property
    def plain(self) -> bool:
        """
        Whether the next message may be taken by a port (`flexarm_ros.wire.rcl_calls`).

        The publisher's last message must have arrived, with its sequence number.  Where messages
        do not identify their publisher, the number alone must be right, as in `_in_sequence`.
        """
        known = (self._unnamed or self.accepted) and self._sequence is not None
        return bool(known) and not (self.near or self._rising or self._gap or self._returned)

    def lend(self, port: Records) -> None:
        """Let a port, an array of one, take the next message of the publisher."""
        assert self._sequence is not None
        port['number'], port['named'], port['state'] = self._sequence, not self._unnamed, EMPTY
        if not self._unnamed:
            port['sender'] = np.frombuffer(self.accepted, np.int64)

    def take_back(self, port: Records, tick: int) -> None:
        """
        Expect the message of ``tick`` next: those before have been used by the port.

        `fetch` reads the message that is still in the port.
        """
        state, self._sequence, self.tick = port['state'].item(), port['number'].item(), tick - 1
        if state == READ:
            self._sequence -= 1
        if state != EMPTY:
            self._returned.append(message_of(port, gid=not self._unnamed))

    @property
    def given_back(self) -> bool:
        """Whether `fetch` has a message to read that the fast path has taken."""
        return bool(self._returned)

    def _ours(self, info: dict[str, Any]) -> bool:
        """Whether a message comes from this run's publisher of the topic."""
        if self._unnamed:
            return True
        self._sender: bytes = info['publisher_gid']['data'][:16]
        return self._sender == self.accepted or not self.accepted

    def _in_sequence(self, info: dict[str, Any], tick: int) -> bool:
        """
        Whether the sequence number follows the last one; see `_next`.

        True if the middleware does not number messages.  A gap is a lost message, unless messages
        do not identify their publisher and the number may be another publisher's, even of one that
        has left: the stamp then decides, or the number if the stamp may differ from the tick's.
        """
        number = info.get('publication_sequence_number')
        if number is None:
            return True
        last = self._sequence
        if last is not None and number != last + 1:
            if self._unnamed and self._exact:
                self._gap = self._jumped = True
            elif self._unnamed and (number <= last or not self._only_publisher()):
                return False
            else:
                raise self._lost(tick)
        self._sequence = number
        return True

    def _lost(self, tick: int) -> RunFailed:
        tick *= self.topic.every
        return RunFailed(self.source, f'tick {tick}: a message on {self.topic.name} is lost')

    def _mixed(self) -> bool:
        """Whether a message may be another arm's clock that cannot be distinguished."""
        if self._unwanted or not self._unnamed:
            return False
        return self._jumped or not self._only_publisher()

    def _only_publisher(self) -> bool:
        """Whether the middleware has connected at most one publisher."""
        return bool(self.handle.get_publisher_count() <= 1)

    def _complain(self, fault: str) -> None:
        """
        Reject a message with a ``fault``; empty: nothing.

        Another arm's clock is not rejected if messages do not identify their publisher.
        """
        if fault and not self._mixed():
            self._reject(self.topic.name, fault)

    def _read(self, data: bytes) -> str:
        """Decode ``data`` and check it; see `_judge`."""
        try:
            stamp, values = self._decode(data)
        except ValueError:  # another layout, which an external node may use
            try:
                stamp, values = self.topic.codec.decode_any(data)
            except ValueError as error:
                return printable(str(error), _FAULT_LENGTH)  # contains text from the network
        return self._judge(data, stamp, values)

    def _judge(self, data: bytes, stamp: int, values: Values) -> str:
        """Accept this as the message of the next tick, or return what is wrong with it."""
        tick = self.tick + 1
        due = self._first_ns + tick * self._period_ns
        if stamp != due and (self._exact or stamp > due):
            if stamp > due and self._gap and self._unwanted and self._only_publisher():
                raise self._lost(tick)
            return f'stamp {stamp} ns where tick {tick * self.topic.every} has {due} ns'
        if self._rising and stamp <= self._last_stamp:
            return f'stamp {stamp} ns again at tick {tick}, or older than the one before'
        if not math.isfinite(sum(values)) and (fault := self._not_finite(values)):
            return f'{fault} at tick {tick}'
        self._last_stamp = stamp
        self.tick, self.data, self.values = tick, data, values
        self._gap = False
        self.accepted = self.accepted or self._sender
        return ''

    def _not_finite(self, values: Values) -> str:
        """Return which value is not finite and which node sent it; empty if all are finite."""
        named = zip(self.topic.codec.fields, values, strict=True)
        wrong = [f'{name} is {value}' for name, value in named if not math.isfinite(value)]
        return f'{wrong[0]}, from {self.sender or self.source},' if wrong else ''

    def fetch_block(self, until: int, into: list[bytes]) -> None:
        """
        Append the messages up to tick ``until`` that have arrived to ``into``.

        Checks as `fetch`, for valid messages in one call.  ``values`` are not set.
        """
        while self.tick < until:
            taken: list[bytes] = []
            try:
                self._take_block(min(until - self.tick, _MOST_MESSAGES), taken)
            finally:
                if not self._judge_block(taken):
                    self._judge_each(taken, into)
                else:
                    into += taken
            if not taken:
                return

    def _take_block(self, most: int, taken: list[bytes]) -> None:
        """Append up to ``most`` messages of this run's publisher to ``taken``, undecoded."""
        if self.near:
            for _ in range(min(most, len(self.arrived))):
                taken.append(self.arrived.popleft()[0])
            return
        if self.plain and rcl_ports.known():
            self._take_plain(most, taken)
            if not self._returned:
                return
        known = self._unnamed or self.accepted
        last = self.tick + 1 + (most if known else 1)
        for tick in range(self.tick + 1 + len(taken), last):
            data = self._next(tick)
            if data is None:
                return
            taken.append(data)

    def _take_plain(self, most: int, taken: list[bytes]) -> None:
        """Do the same as `_take_block`, until a message is not the publisher's next one."""
        if self._block is None:
            self._block = BlockReader(self.handle, self.topic.codec.size)
        self.lend(self._block.port)
        taken += self._block.take(most)
        self.take_back(self._block.port, self.tick + 1)

    def _judge_block(self, messages: Sequence[bytes]) -> bool:
        """Accept these as the messages of the next ticks; False without effect if one is not."""
        if not messages:
            return True
        try:
            stamps, values = self.topic.codec.decode_block(messages)
        except ValueError:
            return False
        first, last = self.tick + 1, self.tick + len(messages)
        due = self._first_ns + self._period_ns * np.arange(first, last + 1)
        ahead = stamps - due
        rising = not self._rising or (np.diff(stamps, prepend=self._last_stamp) > 0).all()
        if not rising or not np.isfinite(values).all() or (ahead > 0).any():
            return False
        if self._exact and ahead.any():
            return False
        self.tick, self.data, self._last_stamp = last, messages[-1], int(stamps[-1])
        self._gap = False
        self.accepted = self.accepted or self._sender
        return True

    def _judge_each(self, messages: Sequence[bytes], into: list[bytes]) -> None:
        """Append the valid messages to ``into`` and reject the others."""
        for data in messages:
            fault = self._read(data)
            self._complain(fault)
            if not fault:
                into.append(data)

    def look(self) -> None:
        """With direct messages: reject those of other publishers, discard the copies."""
        for _ in range(_MOST_MESSAGES):
            taken = self._take(self._type, True) if self.near else None
            if taken is None:
                return
            known = self.accepted and not self._unnamed
            if not (self._ours(taken[1]) if known else self._only_publisher()):
                self._complain(self._unwanted)

    def bind(self, endpoint: Any, means: SenderInfo, rising: bool) -> None:
        """
        Accept messages of the publisher ``endpoint`` only, as far as messages identify it.

        ``rising``: stamps that may differ from the ticks' must increase, so that duplicates are
        caught.
        """
        shared = not self._unwanted  # handles distinguish publishers only on topics of one run
        self._unnamed = means is SenderInfo.NONE or (means is SenderInfo.HANDLE and shared)
        self.accepted = gid_of(endpoint) if means is SenderInfo.GID else b''
        self.sender = node_of(endpoint)
        self._rising = rising and not self._exact


def connect(members: Iterable[tuple[Iterable[Input], Iterable[Output]]]) -> None:
    """
    Let the nodes of one process, each with its inputs and outputs, pass messages directly.

    As with intra-process communication in rclcpp, a message then goes through the middleware only
    while another process subscribes; it is serialized and checked in any case.
    """
    nodes = [(list(inputs), list(outputs)) for inputs, outputs in members]
    entries = [entry for inputs, _ in nodes for entry in inputs]
    for output in [output for _, outputs in nodes for output in outputs]:
        name = output.publisher.topic_name
        output.near = tuple(e for e in entries if e.subscription.topic_name == name)
        for entry in output.near:
            entry.near = True
