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
``/diagnostics``: the state of each participant of a run, once per second of wall time.

Every node reports on itself, from the thread that serves parameters, so that no tick waits for it:
phase and tick, ticks on the fast path, real-time factor, longest wait, number of rejected
messages.  The plant adds the state of each participant, including missing ones.
"""

from __future__ import annotations

import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.nodes.runtime.joining.membership import Membership
from flexarm_ros.nodes.runtime.joining.status import Phase
from flexarm_ros.nodes.runtime.member import MemberNode
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration

TOPIC = '/diagnostics'
"""Absolute, as everywhere in ROS 2: the name of a status contains that of the node."""

PERIOD_S = 1.0
_BAD = (Phase.FAILED, Phase.REFUSED)


class Diagnostics:
    """The reports of one participant."""

    def __init__(self, me: MemberNode, membership: Membership) -> None:
        self._me, self._membership = me, membership
        self._publisher = me.create_publisher(DiagnosticArray, TOPIC, 10)
        self._last = (time.monotonic(), 0)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = me.create_timer(PERIOD_S, self.tell, clock=steady)

    def tell(self) -> None:
        """Publish one report."""
        message = DiagnosticArray(status=[self._status()])
        message.header.stamp = self._me.get_clock().now().to_msg()
        self._publisher.publish(message)

    def flush(self, timeout_s: float) -> None:
        """Wait until every reliable reader has the last report, at most ``timeout_s``."""
        self._publisher.wait_for_all_acked(Duration(seconds=timeout_s))

    def _status(self) -> DiagnosticStatus:
        me = self._me
        values = {**self._progress(), 'rejected messages': str(me.invalid)}
        phase, waits = me.board.mine.phase, me.missing
        values['missing'] = waits
        values.update(me.further_diagnostics())
        if me.ROLE == 'plant':
            values.update(self._participants())
        level = DiagnosticStatus.ERROR if phase in _BAD or me.failed_run else DiagnosticStatus.OK
        if level == DiagnosticStatus.OK and (waits or me.invalid):
            level = DiagnosticStatus.WARN
        return DiagnosticStatus(
            level=level,
            name=f'{me.get_fully_qualified_name()}: lock-step',
            message=waits or me.board.mine.text,
            hardware_id='flexarm_ros',
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )

    def _progress(self) -> dict[str, str]:
        """Return phase, tick and speed since the last report."""
        me = self._me
        timeline = Timeline.of(me.config.run)
        now, tick = time.monotonic(), me.present_tick
        elapsed, ticks = now - self._last[0], max(0, tick - self._last[1])
        self._last = (now, tick)
        longest, me.longest_wait_s = me.longest_wait_s, 0.0
        factor = ticks * timeline.period_ns * 1e-9 / elapsed if elapsed > 0.0 else 0.0
        return {
            'phase': me.board.mine.phase.value,
            'tick': str(tick),
            'ticks on the fast path': str(me.fast_ticks + tick - me.tick),
            'ticks of the run': str(timeline.ticks),
            'real-time factor': f'{factor:.3f}',
            'tick latency mean (ms)': f'{1e3 * elapsed / ticks:.3f}' if ticks else '',
            'longest wait (ms)': f'{1e3 * longest:.3f}',
        }

    def _participants(self) -> dict[str, str]:
        """Return the state of every other participant."""
        membership = self._membership
        found = {}
        for role in membership.required():
            status = membership.status_of(role)
            state = 'external' if role in membership.external else 'missing'
            if status is not None:
                state = f'{status.phase.value} ({status.node})'
            found[f'participant {role}'] = state
        return found
