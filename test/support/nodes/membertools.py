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

"""A member of a run without a node: what the runtime's tests of phases and time limits act on."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.nodes.runtime.ending import Ending
from flexarm_ros.nodes.runtime.joining.status import GOING, Phase, Status
from flexarm_ros.nodes.runtime.member import Member
from flexarm_ros.nodes.runtime.phases import Phases
from flexarm_ros.nodes.runtime.reset import Epochs
from flexarm_ros.nodes.runtime.waiting import Waiting
from nodetools import ROLES


class Calls:
    """An object of which every method records that it was called, and with what."""

    def __init__(self, calls: list[Any], **answers: Any) -> None:
        self._calls, self._answers = calls, answers

    def __getattr__(self, name: str) -> Any:
        def called(*words: Any, **more: Any) -> Any:
            self._calls.append((name, *words, *more.values()))
            return self._answers.get(name)

        return called


class Board:
    """A status board that keeps what is published."""

    def __init__(self, role: str) -> None:
        self.mine = Status(role, f'{role} 1', f'/{role}', Phase.JOINING)
        self.published: list[Status] = []

    @property
    def going(self) -> bool:
        return self.mine.phase in GOING

    def publish(self, **changes: Any) -> None:
        self.mine = replace(self.mine, **changes)
        self.published.append(self.mine)

    def heard(self) -> dict[str, str]:
        return {'heard': 'plant 1'}

    def update(self) -> None: ...

    def remind(self, now: float) -> None: ...

    def flush(self, timeout_s: float) -> None: ...


@dataclass
class Peers:
    """The membership: statuses by role, and what `Membership` has found out."""

    config: Any
    held: dict[str, Status] = field(default_factory=dict)
    external: set[str] = field(default_factory=set)
    deaf: dict[str, None] = field(default_factory=dict)
    joined = matching = True
    built = refused = locked = False
    failure: Exception | None = None

    def required(self) -> list[str]:
        return list(self.held)

    def status_of(self, role: str) -> Status | None:
        return self.held.get(role)

    def put(self, role: str, phase: Phase, **more: Any) -> None:
        self.held[role] = Status(role, f'{role} 1', f'/{role}', phase, **more)

    def join(self, now: float) -> bool:
        return self.joined

    def matched(self, now: float) -> bool:
        return self.matching

    def lock_members(self) -> None:
        self.locked = True

    def watch(self) -> None:
        if self.failure is not None:
            raise self.failure

    def not_ready(self) -> list[str]:
        late = (Phase.JOINING, Phase.RESETTING)
        return [role for role, status in self.held.items() if status.phase in late]

    def waited_for(self, role: str) -> str:
        return ''


class Side:
    """A publisher or subscription; ``acked`` is what its readers have confirmed."""

    def __init__(self, source: str = '', name: str = 'side') -> None:
        self.source, self.topic = source, type('Topic', (), {'name': name})
        self.publisher, self.acked, self.tick = self, True, -1
        self.told: list[int] = []
        self.done: list[str] = []

    def wait_for_all_acked(self, _duration: Any) -> bool:
        return self.acked

    def tell(self, ticks: int) -> None:
        self.told.append(ticks)

    def look(self) -> None:
        self.done.append('look')

    def reset(self) -> None:
        self.done.append('reset')

    def drain(self) -> None:
        self.done.append('drain')


class FakeMember(Member):
    """A member whose peers, publishers and launcher are the test's."""

    def __init__(self, role: str = 'encoder', *overrides: str) -> None:
        self.ROLE = role  # type: ignore[misc]
        self.calls: list[Any] = []
        self.log: list[Any] = []
        self.config = scenario.load('pd_tip', ['duration=0.1', *overrides])
        self.timeline = Timeline.of(self.config.run)
        self.board: Any = Board(role)
        self.supervisor: Any = Calls(self.calls)
        self.supervisor.gone = False
        self.input, self.output = Side('plant', 'plant/state'), Side(name='joint_states')
        self.side_input, self.side_output = Side(), Side()
        self.inputs: Any = {'plant/state': self.input}
        self.outputs: Any = {'joint_states': self.output}
        self.side_inputs: Any = [self.side_input]
        self.side_outputs: Any = [self.side_output]
        self.peers: Any = Peers(self.config)
        for other in ROLES:
            if other != role:
                self.peers.put(other, Phase.READY)
        self.epochs = Epochs(self.peers)
        self.live: Any = Calls(self.calls)
        self.waiting = Waiting(self, self.peers)
        self.ending = Ending(self, self.peers, Calls(self.calls))  # type: ignore[arg-type]
        self.phases = Phases(self, self.peers, self.epochs, self.live, self.waiting, self.ending)

    def get_logger(self) -> Any:
        return Calls(self.log)

    def make_endpoints(self) -> None:
        self.calls.append(('make_endpoints',))

    def build(self) -> None:
        self.calls.append(('build',))

    def warm_up(self) -> None:
        self.calls.append(('warm_up',))

    def close(self) -> None:
        self.calls.append(('close',))

    def check_start(self, now: float) -> None:
        self.change_phase(Phase.RUNNING, extra=self.epochs.extra())

    def check_end(self) -> None:
        if self.tick > self.final_tick:
            self.ending.finish()

    def waiting_for(self) -> tuple[str, str]:
        return 'plant', 'no message on plant/state'

    def names(self) -> list[str]:
        """Return the names of what was called, reports to the launcher left out."""
        return [call[0] for call in self.calls if call[0] != 'report']
