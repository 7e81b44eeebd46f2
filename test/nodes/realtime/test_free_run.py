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
"""What a free-running plant holds, counts and gives up, by a clock of the test's own."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from flexarm_ros.core.parameters.sections import PlantParameters, RunParameters
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.nodes.realtime.free import FreeRun
from flexarm_ros.nodes.runtime.errors import RunFailed
import pytest

PERIOD = 0.01
TIMELINE = Timeline.of(RunParameters(control_period=PERIOD, duration=10.0))


class Command:
    """Commands as the test gives them: the tick that the next poll finds answered."""

    topic = SimpleNamespace(
        name='joint_command',
        nothing=(0.0, 0.0),
    )
    source = 'controller'

    def __init__(self) -> None:
        self.tick, self.at, self.values, self.next = -1, -1.0, (), None

    def poll(self, tick: int) -> bool:
        new, self.next = self.next, None
        if new is not None:
            self.tick, self.at, self.values = new, tick * PERIOD, (float(new), 2.0)
        return new is not None


class Outlet(list[Any]):
    """Keeps what is sent."""

    def send(self, *values: float) -> None:
        self.append(values)


@pytest.fixture
def parts() -> tuple[Command, Outlet, Outlet]:
    """Return commands, and what is told of them and of the times."""
    return Command(), Outlet(), Outlet()


def free_run(parts: tuple[Command, Outlet, Outlet], **parameters: Any) -> FreeRun:
    control: Any = SimpleNamespace(
        rtf=1.0, paused=False, due=lambda tick: tick * PERIOD, pace_s=lambda: PERIOD,
        period_s=lambda: PERIOD,
    )  # fmt: skip
    given: Any = parts
    command, applied, times = given
    plant = PlantParameters(**parameters)
    return FreeRun(plant, TIMELINE, control, [command], [applied], times)


def tick(free: FreeRun, number: int, now: float | None = None) -> tuple[float, ...]:
    """Let a tick begin when it is due and end when the next one is, or at ``now``."""
    free.begin(number, number * PERIOD if now is None else now)
    held = free.end(number, (number + 1) * PERIOD if now is None else now)
    free.tell(number, held)
    return held[0]


def test_the_newest_command_is_held_and_told(parts: tuple[Command, Outlet, Outlet]) -> None:
    command, applied, times = parts
    free = free_run(parts)
    assert tick(free, 0) == (0.0, 0.0)
    command.next = 0
    assert tick(free, 1) == (0.0, 2.0)
    command.next = 2
    assert tick(free, 2) == tick(free, 3) == (2.0, 2.0)
    assert [row[0] for row in applied] == [0, *map(TIMELINE.stamp_ns, (0, 2, 2))]
    assert [row[0] for row in times] == [TIMELINE.stamp_ns(k) for k in range(4)]
    assert times[0][1:] == (0.0, 0.0, -1.0)
    assert times[3][1:] == pytest.approx((0.03, 0.03, 0.02))
    assert (free.live.missed, free.live.held, free.live.late) == (3, 2, 0)


def test_a_controller_that_is_gone_ends_the_run(parts: tuple[Command, Outlet, Outlet]) -> None:
    free = free_run(parts, command_hold=0.035)
    parts[0].next = 0
    for number in range(4):
        tick(free, number)
    with pytest.raises(RunFailed, match='tick 4: no torque on joint_command for 0.035 s'):
        tick(free, 4)


def test_a_force_is_held_beside_it_and_not_counted(parts: tuple[Command, Outlet, Outlet]) -> None:
    command, applied, times = parts
    force, pushed = Command(), Outlet()
    plain: Any = free_run(parts)
    control, inputs, outputs = plain._control, [command, force], [applied, pushed]
    free = FreeRun(PlantParameters(), TIMELINE, control, inputs, outputs, times)  # type: ignore[arg-type]
    force.next = 0
    assert tick(free, 0) == (0.0, 0.0)
    force.next, command.next = 1, 1
    tick(free, 1)
    command.next = 2
    tick(free, 2)
    assert pushed == [(TIMELINE.stamp_ns(k), float(k), 2.0) for k in (0, 1, 1)]
    assert applied[0][0] == 0 and free.live.held == 1


def test_or_leaves_zero_torque_until_it_is_back(parts: tuple[Command, Outlet, Outlet]) -> None:
    command, applied, _ = parts
    free = free_run(parts, command_hold=0.015, command_loss='zero')
    command.next = 0
    assert [tick(free, number) for number in range(3)] == [(0.0, 2.0), (0.0, 2.0), (0.0, 0.0)]
    assert free.lost.startswith('controller: tick 2: no torque')
    assert applied[-1] == (0, 0.0, 0.0)
    command.next = 3
    assert tick(free, 3) == (3.0, 2.0)
    assert not free.lost


def test_a_plant_that_stood_still_does_not_blame_the_controller(
    parts: tuple[Command, Outlet, Outlet],
) -> None:
    free = free_run(parts, command_hold=0.05)
    parts[0].next = 0
    tick(free, 0)
    for number in range(1, 100):
        tick(free, number, now=1.0)
    assert free.live.late == 99
    assert not free.lost
