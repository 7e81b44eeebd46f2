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
Live parameters: checked at once, set at a tick boundary of a run.

``ros2 param set`` is answered on the thread that serves parameters, after the value has been
checked as one in a scenario is.  Before its next tick k the lock-step loop publishes the change
(`flexarm_ros.wire.parameter_event`), waits until the recorder has it, and then answers tick k with
the new value.  The bag thus shows which message was the first with it.
"""

from __future__ import annotations

from collections import deque
import time

from flexarm_ros import scenario
from flexarm_ros.core.parameters.changes import Change
from flexarm_ros.core.parameters.sections import changed, keys, RunConfig, SECTIONS, values_of
from flexarm_ros.nodes.runtime.errors import RunFailed
from flexarm_ros.nodes.runtime.joining.membership import Membership
from flexarm_ros.nodes.runtime.member import MemberNode
from flexarm_ros.nodes.runtime.topics.endpoints import HOT, NO_OVERRIDES
from flexarm_ros.nodes.runtime.topics.graph import qos_profile
from flexarm_ros.wire import parameter_event as changes
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterEvent, SetParametersResult
from rclpy.duration import Duration
from rclpy.parameter import Parameter

_TOLD_S = 2.0


class LiveParameters:
    """The live parameters of one participant; ``waiting``: those to be set at its next tick."""

    def __init__(self, me: MemberNode, membership: Membership) -> None:
        self._me, self._membership = me, membership
        here = values_of(me.config, me.ROLE) if me.ROLE in SECTIONS else {}
        self._keys = {key for key in here if keys(me.ROLE)[key][1].live}
        self.waiting: deque[tuple[str, float]] = deque()
        self._restoring = False
        self.config: RunConfig = me.config
        if not self._keys:
            return
        self._publisher = me.create_publisher(
            ParameterEvent, changes.TOPIC, qos_profile(changes.QOS),
            qos_overriding_options=NO_OVERRIDES,
        )  # fmt: skip
        me.add_on_set_parameters_callback(self._asked)
        me.add_post_set_parameters_callback(self._accepted)

    # --- on the thread that serves parameters ------------------------------------------

    def _asked(self, parameters: list[Parameter]) -> SetParametersResult:
        wanted = {p.name: p.value for p in parameters if p.name in self._keys}
        if not wanted or self._restoring:
            return SetParametersResult(successful=True)
        me = self._me
        if me.finished or not me.under_way:
            reason = f'no run in progress ({me.board.mine.phase.value})'
            return SetParametersResult(successful=False, reason=reason)
        try:
            for key, value in wanted.items():  # rclpy accepts unset values for some parameters
                if value is None:
                    raise ValueError(f'{me.ROLE}.{key}: cannot be unset')
            held = {p: me.get_parameter(p).value for p in self._keys}
            me.check_live(scenario.with_values(self.config, data={me.ROLE: {**held, **wanted}}))
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _accepted(self, parameters: list[Parameter]) -> None:
        if not self._restoring:
            self.waiting += [(p.name, p.value) for p in parameters if p.name in self._keys]
            self._me.return_soon()

    # --- in the lock-step loop -----------------------------------------------------------

    def apply(self) -> None:
        """Set the waiting values from this node's next tick on, once the recorder has them."""
        me = self._me
        self._wait_for_the_recorder()
        while self.waiting:
            key, value = self.waiting.popleft()
            change = Change(me.tick, me.ROLE, key, float(value))
            self._publisher.publish(self._message(change))
            self.config = changed(self.config, change)
            me.get_logger().info(f'{key} = {value!r} from tick {me.tick} on')
        self._publisher.wait_for_all_acked(Duration(seconds=_TOLD_S))
        me.retune(self.config)

    def _wait_for_the_recorder(self) -> None:
        """Wait until the recorder is connected, else it would miss the change; or RunFailed."""
        deadline = time.monotonic() + _TOLD_S
        while not self._membership.heard(changes.TOPIC, self._publisher):
            if time.monotonic() > deadline:
                raise RunFailed(
                    'recorder', f'tick {self._me.tick}: not connected to {changes.TOPIC} within '
                    f'{_TOLD_S:g} s'
                )  # fmt: skip
            time.sleep(0.01)

    def _message(self, change: Change) -> ParameterEvent:
        stamp_ns = self._me.timeline.stamp_ns(change.tick)
        event = ParameterEvent(node=change.node)
        event.stamp.sec, event.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
        parameter = Parameter(change.key, Parameter.Type.DOUBLE, change.value)
        message: ParameterMessage = parameter.to_parameter_msg()
        event.changed_parameters = [message]
        return event

    def restore(self) -> None:
        """Return to the scenario's values at the start of a run."""
        me = self._me
        self.waiting.clear()
        self.config = me.config
        again = [
            Parameter(key, Parameter.Type.DOUBLE, value)
            for key, value in values_of(me.config, me.ROLE).items()
            if key in self._keys and value != me.get_parameter(key).value
        ]
        if again:
            self._restoring = True
            try:
                me.set_parameters(again)
            finally:
                self._restoring = False


class ChangesInput:
    """The recorder's subscription to changes of live parameters."""

    def __init__(self, me: MemberNode, membership: Membership) -> None:
        self._me, self._membership = me, membership
        self._subscription = me.create_subscription(
            ParameterEvent, changes.TOPIC, lambda _: None, qos_profile(changes.QOS),
            callback_group=HOT, raw=True, qos_overriding_options=NO_OVERRIDES,
        )  # fmt: skip
        self._take = self._subscription.handle.take_message

    def take(self) -> list[Change]:
        """Return the changes that have arrived from nodes of the run."""
        found = []
        while (taken := self._take(ParameterEvent, True)) is not None:
            try:
                change = changes.decode(bytes(taken[0]), self._me.timeline.period_ns)
            except ValueError as error:
                self._me.invalid_message(changes.TOPIC, str(error))
                continue
            ours = self._membership.sent_by(change.node, changes.TOPIC, taken[1])
            if ours:
                found.append(change)
            elif ours is None:
                self._me.invalid_message(changes.TOPIC, 'publishers outside this run')
        return found

    def drain(self) -> None:
        """Discard the queue: a new run begins."""
        while self._take(ParameterEvent, True) is not None:
            pass
