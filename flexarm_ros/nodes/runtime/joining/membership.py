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

"""Joining a run: presence of all roles, agreement on the scenario, connections."""

from __future__ import annotations

from itertools import chain
import math
import time
from typing import Any, NoReturn

from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.parts import part_of, readers, roles
from flexarm_ros.core.run.required_parts import ControllerPart, RecorderPart
from flexarm_ros.core.run.results.real_time import outlives_controller
from flexarm_ros.nodes.runtime.errors import NeverMet, RunFailed
from flexarm_ros.nodes.runtime.joining.compatibility import (
    connects,
    publisher_fault,
    shown,
    subscriber_faults,
)
from flexarm_ros.nodes.runtime.joining.config_exchange import (
    Disagreement,
    dump_sections,
    merge_sections,
)
from flexarm_ros.nodes.runtime.joining.status import (
    epoch_of,
    heard_by,
    Phase,
    plant_of,
    Status,
    StatusBoard,
    TOPIC,
    TYPE,
)
from flexarm_ros.nodes.runtime.member import MemberNode
from flexarm_ros.nodes.runtime.process.middleware import gid_prefix, name, source_of
from flexarm_ros.nodes.runtime.process.supervisor import interrupted
from flexarm_ros.nodes.runtime.topics.graph import output_of
from flexarm_ros.nodes.runtime.topics.identity import node_of, sender_of, SenderInfo, UNKNOWN_NODE
from rclpy.publisher import Publisher

_EXTERNAL_AFTER_S = 2.0
"""Seconds after which a publisher without a status counts as an external node."""
_ECHO_S, _ECHO_LOOKS = 1.0, 50
"""Maximum wait for this node's own status, s, and minimum number of polls in it.

A process without processor time polls less often.
"""
_NAMES_S = 5.0
"""Seconds after which nodes of one name that cannot be distinguished end the run."""
_COMPATIBLE_S = 0.2
"""Seconds between searches of the graph for endpoints that never connect."""
_NAMELESS_S = 1.0
"""Seconds within which the graph shows the name of an endpoint's node."""
_CONNECT_S = 15.0
"""Seconds within which nodes that have found each other must be connected; one is usual."""
_OUTSIDERS_S = 0.1
"""Seconds for which the result of a search for publishers outside the run is used."""
_ON_THE_WAY = (Phase.JOINING, Phase.RESETTING)
AT_START = 'start: '
"""Beginning of the reason of a start that has failed."""
_BEGUN = (Phase.RUNNING, Phase.PAUSED, Phase.RESETTING)


class Membership:
    """The members of a run, as known to one participant."""

    def __init__(self, me: MemberNode, board: StatusBoard) -> None:
        self._me = me
        self._board = board
        self.config: RunConfig = me.config
        self.built = False
        self.refused = False
        self._since: float | None = None
        self._newcomers = -1
        self._external_since: dict[str, float] = {}
        self._silent_since: dict[bytes, float] = {}
        self._unmatched_since: float | None = None
        self._next_check = -math.inf
        self._fault_since: float | None = None
        self.deaf: dict[str, None] = {}
        """Reasons why subscriptions outside the run cannot receive from this node."""
        self.external: set[str] = set()
        self._members: dict[str, str] = {}
        self._looks = 0
        self._judged: dict[tuple[str, bytes], tuple[float, bool | None]] = {}

    def required(self) -> list[str]:
        """Return the roles that the run requires, without that of this node."""
        skip = {self._me.ROLE} if self.config.run.record else {self._me.ROLE, 'recorder'}
        return [role for role in roles(self.config) if role not in skip]

    def own_parameters(self) -> str:
        """Return this node's section and the common one as JSON, for the peers."""
        return dump_sections(self._me.config, self._me.ROLE)

    def status_of(self, role: str) -> Status | None:
        """
        Return the status of the node that holds ``role``, None if there is none.

        It is the node that held the role when this node became ready; before, the first of those
        present.  The role of this node has no other holder.
        """
        if role == self._me.ROLE:
            return None
        if role in self._members:
            return self._board.others.get(self._members[role])
        held = self._board.of(role)
        return min(held, key=lambda s: (s.phase.over, s.identity)) if held else None

    def sent_by(self, role: str, topic: str, info: dict[str, Any]) -> bool | None:
        """
        Whether a message on ``topic`` with this ``info`` comes from the holder of ``role``.

        If messages do not carry their publisher's GID: whether it comes from a node of the run;
        None if that is unknown because nodes outside the run publish on the topic too.
        """
        status = self.status_of(role)
        if status is None:
            return role in self.external
        sender, length = sender_of(info), gid_prefix()
        if self._board.sender_info is SenderInfo.GID and length:
            return sender[:length] == self._board.source(status)
        now = time.monotonic()
        until, ours = self._judged.get((topic, sender), (now, None))
        if now >= until:
            ours = None if self._outsiders(topic) else True
            until = math.inf if sender and ours else now + _OUTSIDERS_S
            self._judged[topic, sender] = until, ours
        return ours

    def lock_members(self) -> None:
        """Fix the holders of all roles: later nodes are ignored."""
        held = {role: self.status_of(role) for role in self.required()}
        self._members = {role: status.identity for role, status in held.items() if status}

    # --- joining ---------------------------------------------------------------------

    def join(self, now: float) -> bool:
        """Whether every role is filled and all nodes agree on the scenario; or RunFailed."""
        self._check_patience(now)
        if self._board.sender_info is None:
            self._check_echo(now)
            return False
        self._board.forget_the_gone()
        self._refuse_a_second_holder()
        self._heed_failures()
        self._check_compatibility(now)
        missing = [role for role in self.required() if not self._filled(role, now)]
        if missing:
            self._wait(f'no {", ".join(missing)} has joined')
            self._patience_for(missing, now)
            return False
        if self._awaits_status(now):
            return False
        self._wait('')
        if not self.built:
            self.config = self._merge()
        return True

    def _wait(self, what: str) -> None:
        """Publish what this node is waiting for; empty: nothing."""
        text = what or self._board.mine.phase.value
        if text != self._board.mine.text:
            self._board.publish(text=text)

    def _heed_failures(self) -> None:
        """
        Raise RunFailed with a peer's reason if its start has failed while it knew this node.

        An earlier failure belongs to another attempt to start, and a peer that was interrupted may
        be started again.
        """
        for other in self._board.others.values():
            starting = not plant_of(other) or other.text.startswith(AT_START)
            known = self._board.mine.identity in heard_by(other)
            if other.phase is Phase.FAILED and starting and known and not interrupted(other.text):
                role = other.role if other.role in roles(self.config) else ''
                raise RunFailed(other.blame or role, other.text, reported_by=role)

    def _check_compatibility(self, now: float) -> None:
        """Raise RunFailed if an endpoint of an external node can never connect."""
        if now < self._next_check:
            return
        self._next_check = now + _COMPATIBLE_S
        fault = self._incompatible()
        if fault is None:
            self._fault_since = None
            return
        self._fault_since = now if self._fault_since is None else self._fault_since
        if UNKNOWN_NODE not in fault.reason or now - self._fault_since >= _NAMELESS_S:
            raise fault

    def _incompatible(self) -> RunFailed | None:
        me = self._me
        requested = {
            entry.topic: entry.subscription.qos_profile
            for entry in me.inputs.values()
            if entry.source != 'plant'  # never external; /clock is shared with other arms
        }
        for topic, qos in requested.items():
            fault = publisher_fault(me, topic.name, topic.type_name, qos)
            if fault:
                return RunFailed(topic.node, f'start: {fault}')
        fault = publisher_fault(me, TOPIC, TYPE, self._board.read_qos)
        if fault:
            return RunFailed('', f'start: {fault}')
        for output in me.outputs.values():
            name, qos = output.topic.name, output.publisher.qos_profile
            for endpoint, fault in subscriber_faults(me, name, output.topic.type_name, qos):
                role = self._external_reader(name, source_of(endpoint))
                if role:
                    return RunFailed(role, f'start: {fault}')
                if UNKNOWN_NODE not in fault:
                    self.deaf[fault] = None
        return None

    def _external_reader(self, topic: str, source: bytes) -> str:
        """Return the role of the external node ``source`` that reads ``topic``, else empty."""
        for role in readers(topic, self.config):
            own = output_of(role, self.config)
            if own and any(source_of(e) == source for e in self._outsiders(own)):
                return role
        return ''

    def _check_patience(self, now: float) -> None:
        """Restart the limit on joining when another node appears."""
        if self._since is None or self._newcomers != self._board.newcomers:
            self._since, self._newcomers = now, self._board.newcomers

    def _check_echo(self, now: float) -> None:
        """Raise RunFailed if the middleware does not deliver this node's own status."""
        self._looks += 1
        if self._since is None or now - self._since <= _ECHO_S or self._looks <= _ECHO_LOOKS:
            return
        raise RunFailed(
            '', f"start: {name()} does not deliver a node's own messages on {TOPIC}, which are "
            'needed to identify publishers'
        )  # fmt: skip

    def _patience_for(self, missing: list[str], now: float) -> None:
        limit = self._me.config.run.start_timeout
        if self._since is not None and now - self._since > limit:
            names = ', '.join(missing)
            raise NeverMet(missing[0], f'start: no {names} joined within {limit:g} s')

    def _refuse_a_second_holder(self) -> None:
        """Raise RunFailed if another node holds this role, or held it when the run began."""
        role = self._me.ROLE
        for other in self._board.of(role):
            if other.phase.over:
                continue
            earlier = other.phase is not Phase.JOINING
            if earlier or other.identity < self._board.mine.identity:
                self._refuse(f'another {role} ({other.node}) takes part in this run')
        plant = self.status_of('plant')
        if plant is not None and plant.phase in _BEGUN:
            # It waits for all roles before it begins: another node holds, or held, this one.
            self._refuse(f'this run has begun already; a new {role} cannot join it')
        if role == 'plant':
            self._refuse_a_second_plant()

    def _refuse_a_second_plant(self) -> None:
        """Raise RunFailed if a peer is in a run with another plant, which may have ended."""
        for other in self._board.others.values():
            if not other.phase.over and plant_of(other) not in ('', self._board.mine.identity):
                self._refuse(f'{other.node} takes part in a run with another plant')

    def _refuse(self, why: str) -> NoReturn:
        self.refused = True
        raise RunFailed(self._me.ROLE, f'refused: {why}')

    def _awaits_status(self, now: float) -> bool:
        """
        Whether the status of a node in the graph has not arrived yet, for at most 2 s.

        The node may be another holder of this role.
        """
        since = self._silent_since
        self._silent_since = {source: since.get(source, now) for source in self._board.silent()}
        return any(now - first < _EXTERNAL_AFTER_S for first in self._silent_since.values())

    def _filled(self, role: str, now: float) -> bool:
        """Whether a participant, or after 2 s an external node, fills ``role``."""
        ours = [s for s in self._board.of(role) if not s.phase.over]
        if ours:
            self.external.discard(role)
            return True
        topic = output_of(role, self.config)
        if not topic or not self._listening(role, self._outsiders(topic)):
            self._external_since.pop(role, None)
            return False
        since = self._external_since.setdefault(role, now)
        if now - since < _EXTERNAL_AFTER_S:
            return False
        self.external.add(role)
        return True

    def _listening(self, role: str, outsiders: list[Any]) -> bool:
        """
        Whether the node of these publishers subscribes to the inputs of ``role``.

        Discovery shows a node's publishers before its subscriptions; a run that began in between
        would lose the first message.
        """
        senders = {source_of(endpoint) for endpoint in outsiders}
        topics = part_of(role).reads(self.config)
        readers = {
            source_of(endpoint)
            for topic in topics
            for endpoint in self._me.get_subscriptions_info_by_topic(
                self._me.resolve_topic_name(topic)
            )
        }
        return bool(senders & readers if topics else senders)

    def _outsiders(self, topic: str) -> list[Any]:
        """Return the publishers of ``topic`` that belong to no participant."""
        resolved = self._me.resolve_topic_name(topic)
        known = self._board.writers()
        return [
            endpoint
            for endpoint in self._me.get_publishers_info_by_topic(resolved)
            if source_of(endpoint) not in known
        ]

    def _merge(self) -> RunConfig:
        """
        Return the scenario composed of every participant's own section.

        Raises RunFailed if two nodes disagree on a shared parameter.
        """
        held = [self.status_of(role) for role in self.required()]
        texts = {s.role: (s.node, s.parameters) for s in held if s and not s.phase.over}
        try:
            return merge_sections(self._me.config, texts)
        except Disagreement as error:
            raise RunFailed('', f'start: the nodes disagree: {error}') from None

    # --- connections -------------------------------------------------------------------

    def matched(self, now: float) -> bool:
        """Whether every input and output is connected; RunFailed after 15 s."""
        inputs = (i.topic.name for i in self._me.inputs.values() if not self._input_matched(i))
        outputs = (
            o.topic.name
            for o in self._me.outputs.values()
            if not self.heard(o.topic.name, o.publisher, not o.topic.recorded_from)
        )
        late = next(chain(inputs, outputs), None)
        self._wait(f'{late} is not connected' if late else '')
        if late is None:
            return True
        self._unmatched_since = now if self._unmatched_since is None else self._unmatched_since
        limit = min(_CONNECT_S, self._me.config.run.start_timeout)
        waited = now - self._unmatched_since
        if waited > min(_NAMES_S, limit):
            self._check_names()
        if waited > limit:
            raise NeverMet(
                '', f'start: {late} is not connected within {limit:g} s{self._seen_of(late)}'
            )
        return False

    def _seen_of(self, topic: str) -> str:
        """Return publishers and readers of ``topic`` in the graph, and the connected number."""
        me, name = self._me, self._me.resolve_topic_name(topic)
        said = []
        if topic in me.inputs:
            found = [node_of(e) for e in me.get_publishers_info_by_topic(name)]
            count = me.inputs[topic].subscription.handle.get_publisher_count()
            said.append(f'publishers found: {", ".join(found) or "none"}; connected: {count}')
        if topic in me.outputs:
            found = [node_of(e) for e in me.get_subscriptions_info_by_topic(name)]
            count = me.outputs[topic].publisher.get_subscription_count()
            said.append(f'readers found: {", ".join(found) or "none"}; connected: {count}')
        return f' ({"; ".join(said)})' if said else ''

    def _check_names(self) -> None:
        """Raise RunFailed if nodes of one name cannot be distinguished."""
        for role in self.required():
            status = self.status_of(role)
            if status is not None and not self._board.source(status):
                raise RunFailed(
                    '', f'start: two nodes are named {status.node}, which {name()} does not '
                    'distinguish; rename one of them (-r __node:=NAME)'
                )  # fmt: skip

    def _input_matched(self, entry: Any) -> bool:
        endpoints = self._me.get_publishers_info_by_topic(entry.subscription.topic_name)
        outsiders = self._outsiders(entry.topic.name)
        if entry.source in self.external:
            mine = outsiders
        else:
            status = self.status_of(entry.source)
            source = self._board.source(status) if status and not status.phase.over else b''
            mine = [e for e in endpoints if source and source_of(e) == source]
            if entry.topic.name == '/clock':
                outsiders = []  # other arms of the graph publish a clock too
            mine += outsiders
        if len(mine) > 1:
            nodes = ' and '.join(sorted(node_of(endpoint) for endpoint in mine))
            raise RunFailed('', f'start: two publishers on {entry.topic.name}: {nodes}')
        if not mine or entry.subscription.handle.get_publisher_count() < 1:
            return False
        assert self._board.sender_info is not None
        # A sensor that holds its samples repeats stamps.
        held = part_of(entry.source).holds(self.config)
        rising = entry.source in self.external and not held
        entry.bind(mine[0], self._board.sender_info, rising)
        return True

    def heard(self, topic: str, publisher: Publisher, recorded: bool = True) -> bool:
        """
        Whether the readers are present, and all of them that can be are connected.

        ``recorded``: the recorder reads this topic itself.
        """
        roles = [r for r in readers(topic, self.config) if r in self.required()]
        roles = [r for r in roles if recorded or r != RecorderPart.NAME]
        endpoints = self._me.get_subscriptions_info_by_topic(publisher.topic_name)
        for role in roles:
            if role in self.external:
                continue
            status = self.status_of(role)
            if status is None:
                return False
            source = self._board.source(status)
            if not source or not any(source_of(e) == source for e in endpoints):
                return False
        mine = shown(publisher.qos_profile)
        able = sum(connects(mine, e.qos_profile) for e in endpoints)
        return bool(publisher.get_subscription_count() >= able >= min(1, len(roles)))

    # --- while it runs -------------------------------------------------------------------

    def all_ready(self, epoch: int) -> bool:
        """Whether every participant is ready in the run ``epoch``."""
        for role in self.required():
            if role in self.external:
                continue
            status = self.status_of(role)
            if status is None or status.phase in _ON_THE_WAY:
                return False
            if epoch_of(status) != epoch:
                return False
        return True

    def not_ready(self) -> list[str]:
        """Return the roles that are still joining or resetting."""
        late = []
        for role in self.required():
            status = self.status_of(role)
            if role not in self.external and (status is None or status.phase in _ON_THE_WAY):
                late.append(role)
        return late

    def watch(self) -> None:
        """Raise RunFailed if a peer has failed."""
        for role in self.required():
            status = self.status_of(role)
            if role == ControllerPart.NAME and outlives_controller(self.config):
                continue
            if status is not None and status.phase in (Phase.FAILED, Phase.REFUSED):
                raise RunFailed(status.blame or role, status.text, reported_by=role)

    def waited_for(self, role: str) -> str:
        """Return what the node of ``role`` is waiting for while it joins; else empty."""
        status = self.status_of(role)
        joining = status is not None and status.phase is Phase.JOINING
        return (
            f': {status.text}' if status and joining and status.text != status.phase.value else ''
        )
