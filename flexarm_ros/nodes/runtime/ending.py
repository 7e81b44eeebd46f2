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

"""How a participant leaves its run: complete, failed or interrupted."""

from __future__ import annotations

import time
import traceback

from flexarm_ros.core.run.answers import PartError, PartInterrupt
from flexarm_ros.nodes.runtime.diagnostics import Diagnostics
from flexarm_ros.nodes.runtime.errors import NeverMet, RunFailed
from flexarm_ros.nodes.runtime.joining.membership import Membership
from flexarm_ros.nodes.runtime.joining.status import Phase
from flexarm_ros.nodes.runtime.member import Member
from rclpy.duration import Duration

_FLUSH_S = 4.0
_REPAIR_S = 1.0
"""Wall time in which a stopped process has requested the messages that it missed, s."""
_FAILED_FLUSH_S = 1.0
_INTERRUPTED_FLUSH_S = 2.0
_ACK_SLICE_S = 0.2
_STATUS_FLUSH_S = 1.0


def describe(error: BaseException) -> str:
    """Return an error's name and text in one line of at most 300 characters."""
    return ' '.join(f'{type(error).__name__}: {error}'.split())[:300]


class Ending:
    """Ends the run of one participant, once."""

    def __init__(self, me: Member, membership: Membership, diagnostics: Diagnostics) -> None:
        self._me, self._membership, self._diagnostics = me, membership, diagnostics
        self._closed = False

    def failure_of(self, error: BaseException) -> RunFailed:
        """Return ``error`` as RunFailed; the traceback of an unexpected one goes to the log."""
        if isinstance(error, RunFailed):
            return error
        me = self._me
        me.get_logger().error(''.join(traceback.format_exception(error)))
        if isinstance(error, (PartError, PartInterrupt)):
            blame, _, reason = ' '.join(str(error).split())[:300].partition(': ')
            return RunFailed(blame, reason)
        return RunFailed(me.ROLE, f'tick {me.tick}: {describe(error)}')

    def finish(self) -> None:
        """
        Leave a run that is complete for this node.

        Raises RunFailed if the role's files cannot be completed; the node has then not left.
        """
        me = self._me
        if me.finished:
            return
        me.finished = True
        self.flush()
        try:
            self._close()
        except Exception as error:
            me.finished = False
            raise self.failure_of(error) from None
        me.change_phase(Phase.DONE, text=f'done after {me.tick} ticks', last_tick=me.tick - 1)
        me.board.flush(_STATUS_FLUSH_S)

    def fail(self, failure: RunFailed) -> None:
        """Leave a run that cannot continue: log, report and publish the reason."""
        me = self._me
        if me.finished:
            return
        me.finished, me.failure = True, failure
        reporter = f'ended by the {failure.reported_by}: ' if failure.reported_by else ''
        blamed = f'{failure.blame}: ' if failure.blame else ''
        me.get_logger().error(f'{reporter}{blamed}{failure.reason}')
        me.supervisor.report(
            me.ROLE, phase='failed', blame=failure.blame, text=failure.reason, tick=me.tick,
            never_met=isinstance(failure, NeverMet),
        )  # fmt: skip
        phase = Phase.REFUSED if self._membership.refused else Phase.FAILED
        me.board.publish(
            phase=phase, text=failure.reason, blame=failure.blame, extra=me.board.heard()
        )
        try:
            self._close()
        except Exception as error:  # the run has failed already, for another reason
            me.get_logger().error(describe(error))
        self.flush(_FAILED_FLUSH_S)  # what this node has sent is to be recorded
        self._diagnostics.tell()
        me.board.flush(_STATUS_FLUSH_S)
        self._diagnostics.flush(_STATUS_FLUSH_S)

    def flush(self, limit_s: float | None = None) -> None:
        """
        Wait until every reader has this node's messages, at most ``limit_s`` (s).

        The default is the time that a stopped peer may take (``tick_timeout`` and 1 s), at least
        4 s: a lost message is requested at the writer's next heartbeat, which Fast DDS sends every
        3 s without this package's settings (`flexarm_ros.nodes.runtime.process.middleware`).  At
        most 2 s once the user has interrupted the run.
        """
        me = self._me
        if limit_s is None:
            limit_s = max(_FLUSH_S, me.config.run.tick_timeout + _REPAIR_S)
        began = time.monotonic()
        for output in [*me.outputs.values(), *me.side_outputs]:
            # In slices, so that a signal is noticed between them.
            while not output.publisher.wait_for_all_acked(Duration(seconds=_ACK_SLICE_S)):
                if me.interrupted or me.supervisor.gone:
                    limit_s = min(limit_s, _INTERRUPTED_FLUSH_S)
                if time.monotonic() - began > limit_s:
                    return

    def _close(self) -> None:
        if not self._closed:
            self._closed = True
            self._me.close()
