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
The standard services of simulation_interfaces, if that package is installed.

``get_simulator_features``, ``get_simulation_state``, ``set_simulation_state``,
``step_simulation`` and ``reset_simulation``, with the results that the standard's ``.srv`` files
specify (version 1.0 to 2.1), and the action ``simulate_steps``.  This simulator has no worlds or
entities.
"""

from __future__ import annotations

import importlib
from typing import Any, TYPE_CHECKING

from rclpy.node import Node

if TYPE_CHECKING:
    from flexarm_ros.nodes.run_control.services import RunControl

_TIME_AND_STATE = 1 | 2
"""ResetSimulation's SCOPE_TIME and SCOPE_STATE; there are never spawned entities (4)."""


def offer_standard_services(node: Node, control: RunControl) -> bool:
    """Create the services; False if simulation_interfaces is not installed."""
    try:
        srv = importlib.import_module('simulation_interfaces.srv')
        msg = importlib.import_module('simulation_interfaces.msg')
        action = importlib.import_module('simulation_interfaces.action')
    except ImportError:
        return False
    # Imported here, so that nodes without the package do not load the action libraries.
    from flexarm_ros.nodes.run_control.simulation_action import StepAction

    StepAction(node, control, action.SimulateSteps, msg.Result)
    standard = StandardServices(control, msg, srv)
    for kind, name, action in (
        (srv.GetSimulatorFeatures, 'get_simulator_features', standard.features),
        (srv.GetSimulationState, 'get_simulation_state', standard.state),
        (srv.SetSimulationState, 'set_simulation_state', standard.set_state),
        (srv.StepSimulation, 'step_simulation', standard.step),
        (srv.ResetSimulation, 'reset_simulation', standard.reset),
    ):
        node.create_service(kind, name, action)
    return True


class StandardServices:
    """Implementation of the services; ``msg`` and ``srv`` are the package's modules."""

    def __init__(self, control: RunControl, msg: Any, srv: Any) -> None:
        self._control = control
        self._features = msg.SimulatorFeatures
        self._states = msg.SimulationState
        self._result = msg.Result
        self._set_state = srv.SetSimulationState.Response
        self._stopped = False

    def _answer(self, response: Any, problem: str = '', code: int | None = None) -> Any:
        """Set the result: OK without a ``problem``, else ``code`` or OPERATION_FAILED."""
        failed = self._result.RESULT_OPERATION_FAILED if code is None else code
        response.result.result = failed if problem else self._result.RESULT_OK
        response.result.error_message = problem
        return response

    def features(self, _: Any, response: Any) -> Any:
        """Return the features of this simulator."""
        kinds = self._features
        response.features.features = [
            kinds.SIMULATION_RESET, kinds.SIMULATION_STATE_GETTING, kinds.SIMULATION_STATE_SETTING,
            kinds.SIMULATION_STATE_PAUSE, kinds.STEP_SIMULATION_SINGLE,
            kinds.STEP_SIMULATION_MULTIPLE, kinds.STEP_SIMULATION_ACTION,
        ]  # fmt: skip
        response.features.custom_info = 'flexarm_ros: a step is one tick, /**.control_period'
        return response

    def current(self) -> int:
        """Return the state in the standard's terms; stopped before the first tick."""
        states, control = self._states, self._control
        if control.over:
            return int(states.STATE_QUITTING)
        if not control.going:
            return int(states.STATE_STOPPED)
        if not control.paused:
            self._stopped = False  # changed through the other services
            return int(states.STATE_PLAYING)
        return int(states.STATE_STOPPED if self._stopped else states.STATE_PAUSED)

    def state(self, _: Any, response: Any) -> Any:
        """Return whether the run is playing, paused or stopped."""
        response.state.state = self.current()
        return self._answer(response)

    def set_state(self, request: Any, response: Any) -> Any:
        """Play, pause, stop (pause and reset) or quit."""
        wanted, states = request.state.state, self._states
        names = {
            states.STATE_PLAYING: 'PLAYING', states.STATE_PAUSED: 'PAUSED',
            states.STATE_STOPPED: 'STOPPED', states.STATE_QUITTING: 'QUITTING',
        }  # fmt: skip
        if wanted not in names:
            text = f'state {wanted}: allowed: ' + ', '.join(f'STATE_{n}' for n in names.values())
            return self._answer(response, text, self._result.RESULT_FEATURE_UNSUPPORTED)
        if wanted == self.current():
            code = self._set_state.ALREADY_IN_TARGET_STATE
            return self._answer(response, f'already {names[wanted].lower()}', code)
        if self._control.over:
            code = self._set_state.INCORRECT_TRANSITION
            return self._answer(response, 'the run has ended', code)
        problem = self._enter(wanted)
        return self._answer(response, problem, self._set_state.STATE_TRANSITION_ERROR)

    def _enter(self, wanted: int) -> str:
        """Change to a state; return the error, empty on success."""
        if wanted == self._states.STATE_QUITTING:
            self._control.end()
            return ''
        self._control.pause(wanted != self._states.STATE_PLAYING)
        problem = self._control.reset() if wanted == self._states.STATE_STOPPED else ''
        self._stopped = wanted == self._states.STATE_STOPPED and not problem
        return problem

    def step(self, request: Any, response: Any) -> Any:
        """Execute ``steps`` ticks of a paused run; responds when they are done."""
        if not self._control.step(int(request.steps)):
            return self._answer(response, 'not paused: pause first')
        self._stopped = False
        done = self._control.finish_steps()
        return self._answer(
            response, '' if done else 'the run ended before, or the time limit was exceeded'
        )

    def reset(self, request: Any, response: Any) -> Any:
        """Restart at tick 0; state and time cannot be reset separately."""
        scope = int(request.scope)
        if scope and scope & _TIME_AND_STATE != _TIME_AND_STATE:
            text = f'scope {scope}: state and time are reset together: 0, 3 or 255'
            return self._answer(response, text, self._result.RESULT_FEATURE_UNSUPPORTED)
        return self._answer(response, self._control.reset())
