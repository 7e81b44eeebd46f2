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

from flexarm_ros.api.episode import changed, Episode
from flexarm_ros.api.extras import extra
from flexarm_ros.api.numbers import within
from flexarm_ros.api.simulation import Scenario
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.parameters.sections import Spec
from flexarm_ros.core.timeline import Timeline
import numpy as np
from numpy.typing import ArrayLike, NDArray

with extra('gymnasium'):
    import gymnasium
    from gymnasium.error import InvalidAction, ResetNeeded

SEEDS = 2**31 - 1
TORQUE = 1024.0
"""Torque, N m, of an action of 1 if neither the caller nor the scenario sets a limit."""

HOLD_SPEC = Spec('int', 'ticks', '', low=1)
TORQUE_SPEC = Spec('float', 'N m', '', low=0.0, low_open=True, high=1e9)


class FlexArmEnv(gymnasium.Env[FloatArray, FloatArray]):
    """
    A scenario whose controller is the agent.

    Also created by ``gymnasium.make('flexarm_ros/Square-v0')``, with the same arguments.

    Observation, shape ``(14,)``, as delivered to the nodes at this tick, with latency and noise:
    encoder (theta1, theta2 and rates; rad, rad/s), tip sensor (x, y, vx, vy), reference
    (x, y, vx, vy), end deflections (delta1, delta2); m, m/s, frame ``base``.

    Action, shape ``(2,)``, clipped to -1 to 1: tau1 and tau2 as fractions of ``torque`` N m, held
    for ``hold`` ticks.  Reward: the negative mean distance, m, of the end effector (kinematics of
    the joint angles, as ``rms_error``) from the reference over those ticks.  Instability ends
    the episode (terminated) and costs the larger ``plant.deflection_limit`` (5 m for the
    paper's arm) for each remaining step; the scenario's duration truncates it.

    Parameters
    ----------
    scenario
        As for :func:`flexarm_ros.simulate`; its control law is not used.
    hold
        Number of ticks for which an action is held.
    torque
        N m of an action of 1; default ``controller.torque_limit``, or 1024 if that is 0.
    render_mode
        ``rgb_array``: :meth:`render` draws the arm.  Default: no rendering.
    **changes
        Sections and values as for :func:`flexarm_ros.simulate`.

    """

    metadata: dict[str, Any] = {'render_modes': ['rgb_array'], 'render_fps': 100}

    def __init__(
        self, scenario: Scenario = 'fls_tip', hold: int = 10, torque: float | None = None,
        render_mode: str | None = None, **changes: Any,
    ) -> None:  # fmt: skip
        self._base = changed(scenario, changes)
        self._hold = int(within('hold', hold, HOLD_SPEC))
        limit = self._base.controller.torque_limit or TORQUE
        self._torque = limit if torque is None else within('torque', torque, TORQUE_SPEC)
        self.render_mode = render_mode
        if render_mode not in (None, 'rgb_array'):
            raise ValueError(f'render_mode: {render_mode!r}, allowed: rgb_array or None')
        step = self._hold * Timeline.of(self._base.run).period
        self.metadata = {**self.metadata, 'render_fps': max(1, round(1 / step))}
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float64)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (14,), np.float64)
        self._episode: Episode | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """
        Start a new episode; ``seed`` seeds the noise.

        ``options`` are sections and values as for :func:`flexarm_ros.simulate`, for this
        episode only: ``options={"plant": {"payload_mass": 1.5}}``.  Others raise
        ``ScenarioError``.
        """
        super().reset(seed=seed)
        noise = int(self.np_random.integers(SEEDS))
        self._episode = Episode(changed(self._base, {'seed': noise, **(options or {})}))
        return self._episode.observe(), {'tick': 0}

    def step(self, action: ArrayLike) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """
        Hold the torques for ``hold`` ticks.

        Raises ``gymnasium.error.ResetNeeded`` before the first reset and after the end of an
        episode, ``InvalidAction`` for an action that is not two numbers.
        """
        episode = self._begun('step')
        if episode.ended:
            raise ResetNeeded('step: the episode has ended; call reset first')
        errors = episode.advance(self._torques(action), self._hold)
        observed, info = episode.observe(), {'tick': episode.tick}
        if episode.unstable is None:
            return observed, -float(np.mean(errors)), False, episode.over, info
        reward = -episode.limit * (1 + (episode.ticks - episode.tick) // self._hold)
        return observed, reward, True, False, {**info, 'unstable': episode.unstable}

    def render(self) -> NDArray[np.uint8] | None:
        """Return an image of the arm and its reference, shape ``(480, 480, 3)``."""
        if self.render_mode is None:
            gymnasium.logger.warn("render: make the environment with render_mode='rgb_array'")
            return None
        return self._begun('render').picture()

    def _begun(self, call: str) -> Episode:
        if self._episode is None:
            raise ResetNeeded(f'{call}: no episode has begun; call reset first')
        return self._episode

    def _torques(self, action: ArrayLike) -> FloatArray:
        """Return the torques of an action, N m."""
        try:
            given = np.asarray(action, float)
        except (TypeError, ValueError):
            given = np.full(2, np.nan)
        if given.shape != (2,) or np.isnan(given).any():
            raise InvalidAction(f'action: {action!r}, allowed: two numbers from -1 to 1')
        return np.asarray(np.clip(given, -1.0, 1.0) * self._torque)
