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

"""``fa.FlexArmEnv``: the arm, its sensors and its task as a Gymnasium environment."""

from __future__ import annotations

from typing import Any

from flexarm_ros.api.extras import extra
from flexarm_ros.api.numbers import finite_array, within
from flexarm_ros.api.simulation import configure, Scenario
from flexarm_ros.core.compiled import FloatArray
from flexarm_ros.core.kinematics import rigid_point
from flexarm_ros.core.parameters import RunConfig, Spec
from flexarm_ros.core.plant import instability, make_plant
from flexarm_ros.core.sensors import Encoder, TipSensor
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.core.trajectory import Reference
import numpy as np
from numpy.typing import NDArray

with extra('gymnasium'):
    import gymnasium

SEEDS = 2**31 - 1
TORQUE = 1024.0
"""Torque, N m, of an action of 1 where neither the caller nor the scenario gives a limit."""

HOLD_SPEC = Spec('int', 'ticks', '', low=1)
TORQUE_SPEC = Spec('float', 'N m', '', low=0.0, low_open=True, high=1e9)
ACTION = 'two finite numbers, clipped to -1 to 1'


class FlexArmEnv(gymnasium.Env[FloatArray, FloatArray]):
    """
    A scenario whose controller is the agent.

    Observation, shape ``(14,)``, as the nodes would deliver it at this tick, latency and noise
    included: encoder (theta1, theta2, their rates; rad, rad/s), tip sensor (x, y, vx, vy),
    reference (x, y, vx, vy), end deflections (delta1, delta2); m, m/s, frame ``base``.

    Action, shape ``(2,)``, from -1 to 1: tau1 and tau2 as parts of ``torque`` N m, held for
    ``hold`` ticks.  Reward: minus the mean distance, m, of the end effector (kinematics of the
    joint angles, as ``rms_error``) from the reference over those ticks.  An arm that becomes
    unstable ends the episode (terminated), and pays the larger ``plant.deflection_limit`` (5 m for
    the paper's arm) for every step that is left; the scenario's duration truncates it.

    Parameters
    ----------
    scenario
        As for :func:`flexarm_ros.simulate`; its control law is not used.
    hold
        Ticks an action is held for.
    torque
        N m of an action of 1; left out, ``controller.torque_limit``, or 1024 where that is 0.
    **changes
        Sections and values as for :func:`flexarm_ros.simulate`.

    """

    metadata: dict[str, Any] = {'render_modes': []}

    def __init__(
        self, scenario: Scenario = 'fls_tip', hold: int = 10, torque: float | None = None,
        **changes: Any,
    ) -> None:  # fmt: skip
        self._base = configure(scenario, **changes)
        self._hold = int(within('hold', hold, HOLD_SPEC))
        limit = self._base.controller.torque_limit or TORQUE
        self._torque = limit if torque is None else within('torque', torque, TORQUE_SPEC)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float64)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (14,), np.float64)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """
        Start anew; the noise is drawn by ``seed``.

        ``options`` are sections and values as for :func:`flexarm_ros.simulate` that hold for this
        episode: ``options={"plant": {"payload_mass": 1.5}}``.
        """
        super().reset(seed=seed)
        noise = int(self.np_random.integers(SEEDS))
        self._start(configure(self._base, **{'seed': noise, **(options or {})}))
        return self._observe(), self._info()

    def _start(self, config: RunConfig) -> None:
        self._k, self._ticks = 0, Timeline.of(config.run).ticks
        self._plant, self._reference = make_plant(config), Reference(config)
        self._encoder, self._tip = Encoder(config), TipSensor(config)
        self._lengths = config.plant.length
        self._measure()

    def step(
        self, action: NDArray[np.floating[Any]]
    ) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """Hold the torques for ``hold`` ticks; ``ValueError`` for an action that is not finite."""
        parts = finite_array(f'action at tick {self._k}', action, (2,), ACTION)
        tau1, tau2 = (float(part) * self._torque for part in np.clip(parts, -1.0, 1.0))
        errors, unstable = [], None
        for _ in range(min(self._hold, self._ticks - self._k)):
            self._plant.step(tau1, tau2)
            self._k += 1
            unstable = instability(self._plant)
            if unstable is not None:
                break
            self._measure()
            errors.append(self._error())
        truncated = unstable is None and self._k >= self._ticks
        if unstable is None:
            return self._observe(), -float(np.mean(errors)), False, truncated, self._info()
        left = 1 + (self._ticks - self._k) // self._hold
        info = {**self._info(), 'unstable': unstable}
        return self._observe(), -max(self._plant.limits) * left, True, False, info

    def _measure(self) -> None:
        """Let the sensors answer this tick, as they must once a tick."""
        q, qd = self._plant.q, self._plant.qd
        encoder, tip = self._encoder.measure(self._k, q, qd), self._tip.measure(self._k, q, qd)
        self._held = (*encoder[1:], *tip[1:])

    def _observe(self) -> FloatArray:
        ends = self._plant.deflections()[:2]
        values = np.array([*self._held, *self._reference.command(self._k), *ends])
        return np.asarray(np.nan_to_num(values))

    def _error(self) -> float:
        """Return the distance of the rigid end effector from the undelayed reference, m."""
        th1, th2 = self._plant.q[0], self._plant.q[1]
        x, y, _, _ = rigid_point(*self._lengths, th1, th2, 0.0, 0.0)
        target = self._reference.at(self._k)
        return float(np.hypot(x - target[0], y - target[1]))

    def _info(self) -> dict[str, Any]:
        return {'tick': self._k}
