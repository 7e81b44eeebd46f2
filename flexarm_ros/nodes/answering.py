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

"""The node of every part that answers at each tick: sensors and the controller."""

from __future__ import annotations

import copy
from typing import Any

from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.answers import make_part
from flexarm_ros.core.run.part import Answer, STATE
from flexarm_ros.core.run.parts import part_of
from flexarm_ros.core.run.state import MessageState
from flexarm_ros.nodes.runtime.errors import RunFailed
from flexarm_ros.nodes.runtime.fast_path import FastPath
from flexarm_ros.nodes.runtime.participant import Participant
from flexarm_ros.nodes.runtime.topics.endpoints import Waiter
from flexarm_ros.wire.fused_step import answer_step, compile_loop, FusedStep
from flexarm_ros.wire.topics import per_tick_topics


class AnsweringNode(Participant):
    """Publishes the answer of the role's part to each tick, once all its inputs have arrived."""

    def build(self) -> None:
        """Create the part."""
        kind = part_of(self.ROLE)
        assert issubclass(kind, Answer)
        reads = kind.reads(self.config)
        self._part = make_part(kind, self.config)
        self._late = kind.LATE
        self._reads = [self.inputs[name] for name in reads]
        self._state = self.inputs[STATE] if STATE in reads else None
        self._place = reads.index(STATE) if STATE in reads else None
        # Published ahead: fetched while the plant integrates.
        self._ahead = [entry for entry in self._reads if entry.topic.ahead]
        self._configure(self.config)

    def warm_up(self) -> None:
        """Let a copy of the part answer once."""
        zeros = [(0.0,) * len(entry.topic.codec.fields) for entry in self._reads]
        copy.deepcopy(self._part).answer(0, *self._views(zeros))

    def check_live(self, config: RunConfig) -> None:
        """Raise ValueError if a live parameter of ``config`` is invalid for the part."""
        self._part.check_live(config)

    def retune(self, config: RunConfig) -> None:
        """Let the part take its live parameters, which may change its messages' layout."""
        self._part.retune(config)
        self._configure(config)

    def _configure(self, config: RunConfig) -> None:
        for topic in per_tick_topics(config):
            if topic.name in self.outputs:
                self.outputs[topic.name].configure(topic, self.timeline)
        self._sends = [output.send for output in self.outputs.values()]
        self._several = len(self._sends) > 1
        reads = [entry.topic for entry in self._reads]
        writes = [output.topic for output in self.outputs.values()]
        self._step: FusedStep | None = None
        if self.alone:  # composed nodes hand over values
            self._step = answer_step(self._part, reads, writes, self.timeline.period_ns)
        if self._step is not None:
            compile_loop(self._step)
        self.fast = None

    def advance(self) -> bool:
        """Answer this tick."""
        reads = self._reads
        if not self.have(*reads):
            return False
        tick = self.tick
        answer = self._part.answer(tick, *self._views([entry.values for entry in reads]))
        fault = self._part.fault(tick, answer)
        if fault is not None:
            raise RunFailed(self._part.title, fault)
        for send, message in zip(self._sends, answer if self._several else (answer,), strict=True):
            if self._late:
                send(*message)
            else:
                send(self.timeline.stamp_ns(tick), *message)
        self.tick += 1
        self.check_end()
        if self._step is None:
            for entry in self._ahead:
                entry.fetch(self.tick)
        return True

    def advance_fast(self, waiter: Waiter, until: float) -> None:
        """Answer by the fused step."""
        step, first = self._step, self.tick
        if step is None:
            return
        if self.fast is None:
            handles = [output.publisher.handle for output in self.outputs.values()]
            self.fast = FastPath(step, self._reads, handles, waiter)
        if not self.fast.enter(first, self.waiting.since, until):
            return
        refused = False
        if not self.live.waiting:
            self.tick, refused = self.fast.run(first, self.final_tick)
        self.fast.leave(self.tick, self.waiting)
        if self.tick > first:
            step.leave()
        if refused:  # rclpy raises the reason
            (output,) = self.outputs.values()
            output.publish(step.outputs[0].bytes())

    def _views(self, values: list[Any]) -> list[Any]:
        """Return the values of each input's message in the form that parts expect."""
        if self._place is not None:
            values[self._place] = MessageState(values[self._place])
        return values

    def waiting_for(self) -> tuple[str, str]:
        """Return the plant if there is no state, else the role of the first missing input."""
        # Fetched in turn: a missing input has kept the others from being fetched.
        state = [self._state] if self._state is not None else []
        for entry in (*state, *self.inputs.values()):
            if not entry.fetch(self.tick):
                return entry.source, f'no message on {entry.topic.name}'
        return '', ''

    def patience_s(self) -> float:
        """Report a silent sensor first, but let the plant report what it waits for itself."""
        return 0.5 if self._state is not None and not self._state.fetch(self.tick) else 0.0


def answering_node(role: str) -> type[AnsweringNode]:
    """Return the class of the node that fills ``role``."""
    return type(f'{part_of(role).__name__}Node', (AnsweringNode,), {'ROLE': role})
