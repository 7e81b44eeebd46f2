"""The standard services of simulation_interfaces, where that package is installed.

``get_simulator_features``, ``get_simulation_state``, ``set_simulation_state``,
``step_simulation`` and ``reset_simulation``, with the standard's results.
"""

from __future__ import annotations

import importlib
import time
from typing import TYPE_CHECKING, Any

from rclpy.node import Node

if TYPE_CHECKING:
    from flexarm_ros.nodes.run_control import RunControl

_STEP_LIMIT_S = 60.0


def offer_standard_services(node: Node, control: RunControl) -> bool:
    """Create the services; False where simulation_interfaces is not installed."""
    try:
        srv = importlib.import_module("simulation_interfaces.srv")
        msg = importlib.import_module("simulation_interfaces.msg")
    except ImportError:
        return False
    standard = StandardServices(control, msg)
    for kind, name, action in (
        (srv.GetSimulatorFeatures, "get_simulator_features", standard.features),
        (srv.GetSimulationState, "get_simulation_state", standard.state),
        (srv.SetSimulationState, "set_simulation_state", standard.set_state),
        (srv.StepSimulation, "step_simulation", standard.step),
        (srv.ResetSimulation, "reset_simulation", standard.reset),
    ):
        node.create_service(kind, name, action)
    return True


class StandardServices:
    """The services' actions; ``msg`` is the package's module of messages."""

    def __init__(self, control: RunControl, msg: Any) -> None:
        self._control = control
        self._features = msg.SimulatorFeatures
        self._states = msg.SimulationState
        self._result = msg.Result

    def features(self, _: Any, response: Any) -> Any:
        """Say what can be asked of this simulator."""
        kinds = self._features
        response.features.features = [
            kinds.SIMULATION_RESET, kinds.SIMULATION_RESET_TIME, kinds.SIMULATION_STATE_GETTING,
            kinds.SIMULATION_STATE_SETTING, kinds.SIMULATION_STATE_PAUSE,
            kinds.STEP_SIMULATION_SINGLE, kinds.STEP_SIMULATION_MULTIPLE,
        ]  # fmt: skip
        return response

    def state(self, _: Any, response: Any) -> Any:
        """Say whether the run goes on or is paused."""
        paused = self._control.paused
        response.state.state = self._states.STATE_PAUSED if paused else self._states.STATE_PLAYING
        response.result.result = self._result.RESULT_OK
        return response

    def set_state(self, request: Any, response: Any) -> Any:
        """Pause or go on; other states are not this simulator's."""
        wanted = request.state.state
        if wanted in (self._states.STATE_PLAYING, self._states.STATE_PAUSED):
            self._control.pause(wanted == self._states.STATE_PAUSED)
            response.result.result = self._result.RESULT_OK
        else:
            response.result.result = self._result.RESULT_FEATURE_UNSUPPORTED
            response.result.error_message = "allowed: STATE_PLAYING, STATE_PAUSED"
        return response

    def step(self, request: Any, response: Any) -> Any:
        """Do ``steps`` ticks of a paused run; answers when they are done."""
        if not self._control.step(int(request.steps)):
            response.result.result = self._result.RESULT_INCORRECT_STATE
            response.result.error_message = "pause first"
            return response
        deadline = time.monotonic() + _STEP_LIMIT_S
        while self._control.stepping and time.monotonic() < deadline:
            time.sleep(0.001)
        done = not self._control.stepping
        response.result.result = (
            self._result.RESULT_OK if done else self._result.RESULT_OPERATION_FAILED
        )
        return response

    def reset(self, request: Any, response: Any) -> Any:
        """Start again at tick 0; state and time cannot be reset apart."""
        self._control.reset_wanted = True
        response.result.result = self._result.RESULT_OK
        return response
