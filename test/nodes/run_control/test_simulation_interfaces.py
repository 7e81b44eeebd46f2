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

"""The standard services and action, with a package of the shape of simulation_interfaces 2.1."""

from __future__ import annotations

from collections.abc import Iterator
import sys
import threading
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

run_control = pytest.importorskip('flexarm_ros.nodes.run_control.services', reason='needs rclpy')
simulation_services = pytest.importorskip('flexarm_ros.nodes.run_control.simulation_services')
GoalResponse = pytest.importorskip('rclpy.action').GoalResponse
status = pytest.importorskip('flexarm_ros.nodes.runtime.joining.status')

STOPPED, PLAYING, PAUSED, QUITTING, NO_WORLD = range(5)
UNSUPPORTED, OK, NOT_FOUND, INCORRECT_STATE, FAILED = range(5)
ALREADY, TRANSITION_ERROR, INCORRECT_TRANSITION = 101, 102, 103


def modules() -> tuple[ModuleType, ModuleType, ModuleType]:
    """Return ``simulation_interfaces.msg``, ``.srv`` and ``.action``, as far as they are used."""
    msg, srv = ModuleType('simulation_interfaces.msg'), ModuleType('simulation_interfaces.srv')
    action = ModuleType('simulation_interfaces.action')
    action.SimulateSteps = SimpleNamespace(
        Feedback=SimpleNamespace,
        Result=lambda: SimpleNamespace(result=SimpleNamespace(result=None, error_message='')),
    )
    msg.Result = SimpleNamespace(
        RESULT_FEATURE_UNSUPPORTED=0, RESULT_OK=1, RESULT_NOT_FOUND=2, RESULT_INCORRECT_STATE=3,
        RESULT_OPERATION_FAILED=4,
    )  # fmt: skip
    msg.SimulationState = SimpleNamespace(
        STATE_STOPPED=0, STATE_PLAYING=1, STATE_PAUSED=2, STATE_QUITTING=3, STATE_NO_WORLD=4,
        STATE_LOADING_WORLD=5,
    )  # fmt: skip
    msg.SimulatorFeatures = SimpleNamespace(
        SIMULATION_RESET=20, SIMULATION_RESET_TIME=21, SIMULATION_RESET_STATE=22,
        SIMULATION_RESET_SPAWNED=23, SIMULATION_STATE_GETTING=24, SIMULATION_STATE_SETTING=25,
        SIMULATION_STATE_PAUSE=26, STEP_SIMULATION_SINGLE=31, STEP_SIMULATION_MULTIPLE=32,
        STEP_SIMULATION_ACTION=33,
    )  # fmt: skip
    for name in (
        'GetSimulatorFeatures',
        'GetSimulationState',
        'StepSimulation',
        'ResetSimulation',
    ):
        setattr(srv, name, SimpleNamespace(name=name))
    srv.SetSimulationState = SimpleNamespace(
        Response=SimpleNamespace(
            ALREADY_IN_TARGET_STATE=101, STATE_TRANSITION_ERROR=102, INCORRECT_TRANSITION=103
        )
    )
    return msg, srv, action


class Goal:
    """A goal's handle, as rclpy gives it to what executes the goal."""

    def __init__(self, steps: int) -> None:
        self.request = SimpleNamespace(steps=steps)
        self.is_cancel_requested = False
        self.told: list[tuple[int, int]] = []
        self.outcome = ''

    def publish_feedback(self, feedback: Any) -> None:
        self.told.append((feedback.completed_steps, feedback.remaining_steps))

    def succeed(self) -> None:
        self.outcome = 'succeeded'

    def abort(self) -> None:
        self.outcome = 'aborted'

    def canceled(self) -> None:
        self.outcome = 'canceled'


class Plant:
    """What run control needs of the plant; a thread of its own stands for the lock-step loop."""

    def __init__(self) -> None:
        self.services: dict[str, Any] = {}
        self.actions: dict[str, Any] = {}
        self.finished, self.tick, self.interrupted = False, 0, 0
        self.timeline = SimpleNamespace(period_ns=1_000_000)
        self.board = SimpleNamespace(mine=SimpleNamespace(phase=status.Phase.JOINING))

    @property
    def under_way(self) -> bool:
        return self.board.mine.phase in (status.Phase.RUNNING, status.Phase.PAUSED)

    @property
    def present_tick(self) -> int:
        return self.tick

    def return_soon(self) -> None:
        """Nothing is compiled here."""

    def get_parameter(self, _: str) -> Any:
        return SimpleNamespace(value=0.0)

    def create_service(self, _: Any, name: str, action: Any) -> None:
        self.services[name] = action

    def add_on_set_parameters_callback(self, _: Any) -> None:
        pass

    def create_timer(self, period_s: float, wake: Any, **_: Any) -> Any:
        self.period_s, self.wake = period_s, wake

    def destroy_timer(self, _: Any) -> None:
        self.wake = None

    def loop(self, control: run_control.RunControl, stop: threading.Event) -> None:
        while not stop.wait(0.0002):
            if self.interrupted or self.tick >= 100_000:
                self.finished = True
                return
            if control.reset_wanted:
                self.tick = 0
                control.reset_wanted = False
            elif self.under_way and control.may_begin(self.tick):
                self.tick += 1


@pytest.fixture
def simulator(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Plant, Any]]:
    """Yield a plant whose loop goes on, and a function that calls one of its services."""
    msg, srv, action = modules()
    package = ModuleType('simulation_interfaces')
    for name, module in (('', package), ('.msg', msg), ('.srv', srv), ('.action', action)):
        monkeypatch.setitem(sys.modules, f'simulation_interfaces{name}', module)
    plant, stop = Plant(), threading.Event()

    def server(_: Any, kind: Any, name: str, execute: Any, **callbacks: Any) -> None:
        plant.actions[name] = (execute, callbacks['goal_callback'])

    monkeypatch.setattr('flexarm_ros.nodes.run_control.simulation_action.ActionServer', server)
    control = run_control.RunControl(plant)  # type: ignore[arg-type]
    assert simulation_services.offer_standard_services(plant, control)  # type: ignore[arg-type]
    thread = threading.Thread(target=plant.loop, args=(control, stop))

    def call(name: str, **request: Any) -> Any:
        response = SimpleNamespace(
            result=SimpleNamespace(result=None, error_message=''),
            state=SimpleNamespace(state=None), features=SimpleNamespace(),
        )  # fmt: skip
        return plant.services[name](SimpleNamespace(**request), response)

    thread.start()
    yield plant, call
    stop.set()
    thread.join(10)


def state(call: Any) -> int:
    answer = call('get_simulation_state')
    assert answer.result.result == OK
    return int(answer.state.state)


def set_state(call: Any, wanted: int) -> Any:
    return call('set_simulation_state', state=SimpleNamespace(state=wanted)).result


def test_services_have_the_standard_names_and_features(simulator: Any) -> None:
    plant, call = simulator
    assert {name for name in plant.services if not name.startswith('~')} == {
        'get_simulator_features', 'get_simulation_state', 'set_simulation_state',
        'step_simulation', 'reset_simulation',
    }  # fmt: skip
    answer = call('get_simulator_features')
    assert set(answer.features.features) == {20, 24, 25, 26, 31, 32, 33}
    assert set(plant.actions) == {'simulate_steps'}


def simulate_steps(plant: Plant, goal: Goal, meanwhile: Any = None) -> Any:
    """Run the action as an executor does, ``meanwhile`` at each wake-up; return its result."""
    execute, accept = plant.actions['simulate_steps']
    assert accept(None) == GoalResponse.ACCEPT
    assert accept(None) == GoalResponse.REJECT  # one at a time
    coroutine = execute(goal)
    while True:
        try:
            coroutine.send(None)
        except StopIteration as end:
            assert plant.wake is None  # the timer is gone
            return end.value.result
        if meanwhile is not None:
            meanwhile()
        threading.Event().wait(plant.period_s)
        plant.wake()


def test_the_action_tells_each_step(simulator: Any) -> None:
    plant, call = simulator
    plant.board.mine.phase = status.Phase.RUNNING
    goal = Goal(100)
    result = simulate_steps(plant, goal)
    assert (result.result, result.error_message) == (FAILED, 'not paused: pause first')
    assert goal.outcome == 'aborted'
    assert set_state(call, PAUSED).result == OK
    for steps in (100, 1, 0):
        assert call('step_simulation', steps=1).result.result == OK
        goal, before = Goal(steps), plant.tick
        assert simulate_steps(plant, goal).result == OK
        assert goal.outcome == 'succeeded'
        assert plant.tick == before + steps
        assert goal.told == [(n, steps - n) for n in range(1, steps + 1)]
    assert state(call) == PAUSED


def test_the_action_is_cancelled_between_two_steps(simulator: Any) -> None:
    plant, call = simulator
    plant.board.mine.phase = status.Phase.RUNNING
    assert set_state(call, PAUSED).result == OK
    goal = Goal(90_000)

    def cancel() -> None:
        goal.is_cancel_requested = len(goal.told) > 10

    result = simulate_steps(plant, goal, cancel)
    assert result.error_message == f'cancelled after {len(goal.told)} steps'
    assert goal.outcome == 'canceled'
    assert 10 < len(goal.told) < 90_000
    assert call('step_simulation', steps=0).result.result == OK  # nothing is out any more
    assert len(goal.told) <= plant.tick < 90_000
    assert state(call) == PAUSED


@pytest.mark.parametrize('wanted', [PLAYING, STOPPED, QUITTING])
def test_the_action_ends_where_somebody_else_takes_over(simulator: Any, wanted: int) -> None:
    plant, call = simulator
    plant.board.mine.phase = status.Phase.RUNNING
    assert set_state(call, PAUSED).result == OK
    goal, asked = Goal(90_000), threading.Event()

    def interfere() -> None:
        if len(goal.told) > 10 and not asked.is_set():
            asked.set()
            assert set_state(call, wanted).result == OK

    result = simulate_steps(plant, goal, interfere)
    assert result.result == FAILED
    why = 'the run ended' if wanted == QUITTING else 'another request came'
    assert result.error_message == f'{why} after {len(goal.told)} steps'
    assert goal.outcome == 'aborted'


def test_states_are_those_of_the_standard(simulator: Any) -> None:
    plant, call = simulator
    assert state(call) == STOPPED  # before the run
    plant.board.mine.phase = status.Phase.RUNNING
    assert state(call) == PLAYING
    assert set_state(call, PLAYING).result == ALREADY
    assert set_state(call, PAUSED).result == OK
    assert state(call) == PAUSED
    answer = set_state(call, PAUSED)
    assert (answer.result, answer.error_message) == (ALREADY, 'already paused')
    answer = set_state(call, NO_WORLD)
    assert answer.result == UNSUPPORTED
    assert 'STATE_PLAYING' in answer.error_message


def test_stopping_is_pausing_and_resetting(simulator: Any) -> None:
    plant, call = simulator
    plant.board.mine.phase = status.Phase.RUNNING
    assert set_state(call, PAUSED).result == OK
    assert call('step_simulation', steps=7).result.result == OK
    assert plant.tick >= 7
    assert set_state(call, STOPPED).result == OK
    assert plant.tick == 0
    assert state(call) == STOPPED
    assert set_state(call, STOPPED).result == ALREADY
    assert call('step_simulation', steps=2).result.result == OK
    assert plant.tick == 2
    assert state(call) == PAUSED
    assert set_state(call, PLAYING).result == OK
    assert state(call) == PLAYING


def test_a_step_does_so_many_ticks_and_answers_then(simulator: Any) -> None:
    plant, call = simulator
    plant.board.mine.phase = status.Phase.RUNNING
    answer = call('step_simulation', steps=1).result
    assert answer.result == FAILED  # as StepSimulation.srv has it for one that is not paused
    assert 'pause' in answer.error_message
    assert set_state(call, PAUSED).result == OK
    assert call('step_simulation', steps=0).result.result == OK
    before = plant.tick
    assert call('step_simulation', steps=250).result.result == OK
    assert plant.tick == before + 250


@pytest.mark.parametrize(
    ('scope', 'result'), [(0, OK), (255, OK), (3, OK), (1, 0), (2, 0), (4, 0)]
)
def test_state_and_time_are_reset_together(simulator: Any, scope: int, result: int) -> None:
    plant, call = simulator
    plant.board.mine.phase = status.Phase.RUNNING
    assert set_state(call, PAUSED).result == OK
    assert call('step_simulation', steps=5).result.result == OK
    answer = call('reset_simulation', scope=scope).result
    assert answer.result == result
    assert (plant.tick == 0) is (result == OK)


def test_reset_without_a_run_and_quitting(simulator: Any) -> None:
    plant, call = simulator
    answer = call('reset_simulation', scope=0).result
    assert answer.result == FAILED
    assert 'joining' in answer.error_message
    plant.board.mine.phase = status.Phase.RUNNING
    assert set_state(call, QUITTING).result == OK
    for _ in range(10_000):
        if plant.finished:
            break
        threading.Event().wait(0.001)
    assert state(call) == QUITTING
    assert set_state(call, PLAYING).result == INCORRECT_TRANSITION
    assert call('step_simulation', steps=1).result.result == FAILED
