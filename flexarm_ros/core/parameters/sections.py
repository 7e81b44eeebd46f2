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
Every parameter of a run: name, type, unit, default, range and meaning.

This is the single place where a key of a scenario is defined.  The scenario
reader checks files against it, the nodes declare their ROS parameters from it
and the README's table is printed from it.  A class is a node's section; a
field is a key.  ``key`` in a field's metadata gives the name in the file where
it differs from the field's own (a law's gain, ``lqg.horizon``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from flexarm_ros.core.parameters.changes import Change
from flexarm_ros.core.parameters.planning import PlanningParameters
from flexarm_ros.core.parameters.spec import parameter as _key
from flexarm_ros.core.parameters.spec import Spec, specs

__all__ = [
    'SECTIONS',
    'ControllerParameters',
    'EncoderParameters',
    'PaceParameters',
    'PlantParameters',
    'RecorderParameters',
    'RunConfig',
    'RunParameters',
    'Spec',
    'TipSensorParameters',
    'TrajectoryParameters',
    'changed',
    'specs',
]


@dataclass(frozen=True)
class RunParameters:
    """Section ``/**``: what all nodes of a run share."""

    control_period: float = _key(
        0.001, 'float', 's', 'one tick of the control loop', low=0.0, low_open=True,
        high=3600.0, whole_ns=True, paper='0.001',
    )  # fmt: skip
    duration: float = _key(
        16.0, 'float', 's', 'simulated time of the run, a whole number of ticks', low=0.0,
        low_open=True, high=1.0e7, whole_ns=True, paper='16.0',
    )  # fmt: skip
    sync: str = _key(
        'lockstep', 'str', '', 'lockstep: barrier at every tick; free: paced by the wall clock',
        choices=('lockstep', 'free'),
    )  # fmt: skip
    seed: int = _key(0, 'int', '', 'seed of every noise source', low=0, high=2**31 - 1)
    record: bool = _key(True, 'bool', '', 'the run waits for a recorder; false: it needs none')
    start_timeout: float = _key(
        60.0, 'float', 's', 'wall time that a participant may take to join', low=0.1, high=86400.0
    )
    tick_timeout: float = _key(
        5.0, 'float', 's', 'wall time that a participant may take to answer a tick',
        low=0.01, high=86400.0,
    )  # fmt: skip
    on_invalid: str = _key(
        'error', 'str', '', 'error: an invalid message ends the run; ignore: count it and go on',
        choices=('error', 'ignore'),
    )  # fmt: skip
    clock_rate: float | None = _key(
        None, 'float', 'Hz', 'messages a second on `/clock`, a whole number of ticks apart, the '
        'first at tick 0; 0 or left out: every tick', low=0.0, high=1e9,
    )  # fmt: skip


@dataclass(frozen=True)
class PlantParameters:
    """Section ``plant``: the arm."""

    model: str = _key(
        'eq14', 'str', '',
        'eq14: equation (14) as printed, rigid Coriolis terms only; full: every inertia term '
        'and the foreshortening of the links',
        choices=('eq14', 'full'), paper='eq14',
    )  # fmt: skip
    modes: int = _key(1, 'int', '', 'assumed modes a link', low=1, high=6, paper='1')
    basis: str = _key(
        'arm_modes', 'str', '',
        "shape functions of the full model: arm_modes fits the arm's own modes best; "
        "craig_bampton: static shapes and clamped modes; clamped_free: a cantilever's modes",
        choices=('arm_modes', 'craig_bampton', 'clamped_free'),
    )  # fmt: skip
    length: tuple[float, float] = _key(
        (4.5, 4.5), 'float2', 'm', 'link lengths', low=0.0, low_open=True, high=1e4, paper='4.5'
    )
    mass_density: tuple[float, float] = _key(
        (0.335, 0.335), 'float2', 'kg/m', 'mass a metre of each link', low=0.0, low_open=True,
        high=1e6, paper='0.335',
    )  # fmt: skip
    flexural_rigidity: tuple[float, float] = _key(
        (1676.0, 1676.0), 'float2', 'N m^2', 'EI of each link', low=0.0, low_open=True,
        high=1e12, paper='1676',
    )  # fmt: skip
    hub_inertia: tuple[float, float] = _key(
        (8.0, 8.0), 'float2', 'kg m^2',
        'reflected actuator inertia acting on the rates of theta1 and theta2', low=0.0, high=1e6,
    )  # fmt: skip
    payload_mass: float = _key(0.0, 'float', 'kg', 'point mass at the tip', low=0.0, high=1e6)
    payload_inertia: float = _key(
        0.0, 'float', 'kg m^2', 'rotary inertia at the tip', low=0.0, high=1e6
    )
    link_end_mass: float = _key(
        0.0, 'float', 'kg', 'point mass at the end of link 1', low=0.0, high=1e6
    )
    link_end_inertia: float = _key(
        0.0, 'float', 'kg m^2', 'rotary inertia at the end of link 1', low=0.0, high=1e6
    )
    damping_ratio: float = _key(0.0, 'float', '', 'modal damping ratio', low=0.0, high=1.0)
    substeps: int | None = _key(
        None, 'int', '', 'integrator steps a tick; left out: from the highest frequency',
        low=1, high=100000,
    )  # fmt: skip
    deflection_limit: tuple[float, float] | None = _key(
        None, 'float2', 'm', 'end deflection of each link beyond which the run is unstable; left '
        'out: 10/9 of the length of each link',
        low=0.0, low_open=True, high=1e5, paper='5',
    )  # fmt: skip
    initial_position: tuple[float, float] | None = _key(
        None, 'float2', 'rad', 'joint angles at the start; left out: on the reference',
        low=-1e4, high=1e4,
    )  # fmt: skip
    initial_velocity: tuple[float, float] | None = _key(
        None, 'float2', 'rad/s', 'joint rates at the start; left out: at rest', low=-1e4, high=1e4
    )


@dataclass(frozen=True)
class EncoderParameters:
    """Section ``encoder``: the joint encoders."""

    latency: float = _key(
        0.0, 'float', 's', 'age of a measurement when it is delivered', low=0.0, high=0.999999999,
        whole_ns=True, live=True, paper='0',
    )  # fmt: skip
    resolution: float = _key(
        0.0, 'float', 'rad', 'angle of one count, 0: ideal', low=0.0, high=1.0, live=True
    )
    noise_std: float = _key(
        0.0, 'float', 'rad', 'standard deviation of the angle noise', low=0.0, high=1.0, live=True
    )


@dataclass(frozen=True)
class TipSensorParameters:
    """Section ``tip_sensor``: the position sensor on link 2."""

    location: float = _key(
        9.0, 'float', 'm', 'place from the shoulder along the arm, from the elbow to the tip',
        low=0.0, high=2e4, paper='9.0 or 6.75',
    )  # fmt: skip
    more_locations: tuple[float, ...] | None = _key(
        None, 'floats', 'm', 'places of further sensors, elbow to tip, for the record only: each '
        'like the first, with noise of its own, on `tip_sensor/odometry_1` and so on',
        low=0.0, high=2e4,
    )  # fmt: skip
    measurand: str = _key(
        'rigid', 'str', '', 'rigid: kinematics of the joint angles (Figure 4); elastic: where the '
        'point really is',
        choices=('rigid', 'elastic'),
    )  # fmt: skip
    latency: float = _key(
        0.0, 'float', 's', 'age of a measurement when it is delivered', low=0.0, high=0.999999999,
        whole_ns=True, live=True, paper='(18): 0.001238',
    )  # fmt: skip
    latency_model: str = _key(
        'buffer', 'str', '', 'buffer: exact; pade2: second-order Pade approximation',
        choices=('buffer', 'pade2'),
    )  # fmt: skip
    noise_std: float = _key(
        0.0, 'float', 'm', 'standard deviation of the position noise', low=0.0, high=100.0,
        live=True,
    )  # fmt: skip
    rate: float = _key(
        0.0, 'float', 'Hz', 'samples a second, a whole number of ticks apart; 0: every tick',
        low=0.0, high=1e9,
    )  # fmt: skip


@dataclass(frozen=True)
class TrajectoryParameters:
    """Section ``trajectory``: the commanded motion of the end effector."""

    kind: str = _key(
        'square', 'str', '', 'square: clockwise from lower left, centred on the base',
        choices=('square', 'hold', 'waypoints'), paper='square',
    )  # fmt: skip
    time_law: str = _key(
        'constant', 'str', '', 'constant: speed along a side; smooth: rest to rest on each side',
        choices=('constant', 'smooth'), paper='constant',
    )  # fmt: skip
    side: float = _key(
        12.6, 'float', 'm', 'side of the square', low=0.0, low_open=True, high=1e5, paper='12.6'
    )
    side_time: float = _key(
        4.0, 'float', 's', 'time of one side', low=0.0, low_open=True, high=1e7, whole_ns=True,
        paper='4.0',
    )  # fmt: skip
    delay: float = _key(
        0.0, 'float', 's', 'delay of the commanded input (the forward-loop correction)', low=0.0,
        high=1e4, whole_ns=True, live=True, paper='0',
    )  # fmt: skip
    hold_position: tuple[float, float] | None = _key(
        None, 'float2', 'm', "x, y to hold; left out: the initial pose's end effector, or the "
        "square's lower left corner",
        low=-1e5, high=1e5,
    )  # fmt: skip
    waypoint_times: tuple[float, ...] | None = _key(
        None, 'floats', 's', 'rising times of the way points, the first 0', low=0.0, high=1e7,
        whole_ns=True,
    )  # fmt: skip
    waypoint_x: tuple[float, ...] | None = _key(
        None, 'floats', 'm', 'x of each way point', low=-1e5, high=1e5
    )
    waypoint_y: tuple[float, ...] | None = _key(
        None, 'floats', 'm', 'y of each way point', low=-1e5, high=1e5
    )


@dataclass(frozen=True)
class FeedbackParameters:
    """The control law, and what the paper's take."""

    law: str = _key(
        'fls', 'str', '', 'control law: pd is (20), fls is (21); inverse, passive, lqg, '
        'adaptive: see docs/controllers.md',
        choices=('pd', 'fls', 'open_loop', 'inverse', 'passive', 'lqg', 'adaptive'),
    )  # fmt: skip
    feedback: str = _key(
        'tip_sensor', 'str', '', 'what closes the loop', choices=('encoder', 'tip_sensor')
    )
    velocity_source: str = _key(
        'feedback', 'str', '', 'feedback: rates as measured with the position; encoder: '
        'undelayed joint rates',
        choices=('feedback', 'encoder'),
    )  # fmt: skip
    kp: float = _key(
        150.79, 'float', 'N/m', 'proportional gain of (10)', low=0.0, high=1e9, live=True,
        paper='150.79',
    )  # fmt: skip
    kd: float = _key(
        17.364, 'float', 'N s/m', 'derivative gain of (11)', low=0.0, high=1e9, live=True,
        paper='17.364',
    )  # fmt: skip
    ks: float = _key(
        15.0, 'float', '', 'scaling gain K_s of (21)', low=0.0, high=1e6, live=True, paper='15'
    )
    kn: float = _key(
        5.0, 'float', 'm', 'normalising gain K_n of the deflections', low=0.0, low_open=True,
        high=1e6, live=True, paper='5',
    )  # fmt: skip
    torque_file: str | None = _key(
        None, 'str', '', 'CSV t,tau1,tau2 of law open_loop, relative to the scenario'
    )
    torque_limit: float = _key(
        0.0, 'float', 'N m', 'largest torque of each joint, 0: none', low=0.0, high=1e9, live=True
    )


@dataclass(frozen=True)
class ControllerParameters(PlanningParameters, FeedbackParameters):
    """Section ``controller``: the control law and its gains."""


@dataclass(frozen=True)
class RecorderParameters:
    """Section ``recorder``: the bag."""

    compression: str = _key(
        'zstd', 'str', '', "compression of the bag's chunks", choices=('none', 'lz4', 'zstd')
    )
    chunk_time: float = _key(
        0.2, 'float', 's', 'simulated time between flushed chunks', low=0.0, low_open=True,
        high=3600.0,
    )  # fmt: skip


SECTIONS: dict[str, type] = {
    '/**': RunParameters,
    'plant': PlantParameters,
    'encoder': EncoderParameters,
    'tip_sensor': TipSensorParameters,
    'trajectory': TrajectoryParameters,
    'controller': ControllerParameters,
    'recorder': RecorderParameters,
}
"""Section name in a scenario file -> class of its keys."""


@dataclass(frozen=True)
class PaceParameters:
    """
    How a run's nodes are paced: in section ``/**`` or ``plant``, and the plant's parameters.

    They change no number of a run: a simulation ignores them, and no bag records them.
    """

    real_time_factor: float = _key(
        0.0, 'float', '', 'hold the nodes of a run to this multiple of real time; 0: no limit',
        low=0.0, high=1e6, live=True,
    )  # fmt: skip
    step_ticks: int = _key(
        1, 'int', '', 'ticks that the service `plant/step` lets a paused run do', low=1,
        high=10**9, live=True,
    )  # fmt: skip
    start_paused: bool = _key(
        False, 'bool', '', 'the nodes of a run wait before tick 0 for the service `plant/pause` '
        '(data: false) or `plant/step`',
    )  # fmt: skip


@dataclass(frozen=True)
class RunConfig:
    """
    A whole, checked scenario: what every layer passes around.

    ``torques`` holds the rows of the torque file, shape ``(rows, 3)`` as
    nested tuples ``(t, tau1, tau2)``, empty unless the law is ``open_loop``.
    ``changes`` are the live parameters that were set while a recorded run went
    on; a scenario file has none.  ``pace`` changes no number of the run and is not recorded.
    """

    run: RunParameters = RunParameters()
    plant: PlantParameters = PlantParameters()
    encoder: EncoderParameters = EncoderParameters()
    tip_sensor: TipSensorParameters = TipSensorParameters()
    trajectory: TrajectoryParameters = TrajectoryParameters()
    controller: ControllerParameters = ControllerParameters()
    recorder: RecorderParameters = RecorderParameters()
    torques: tuple[tuple[float, float, float], ...] = ()
    changes: tuple[Change, ...] = ()
    pace: PaceParameters = PaceParameters()


def changed(config: RunConfig, change: Change) -> RunConfig:
    """Return ``config`` with a live parameter set; ``KeyError`` where there is no such."""
    name, spec, _ = specs(SECTIONS[change.node])[change.key]
    if not spec.live:
        raise KeyError(f'{change.node}.{change.key}')
    section = replace(getattr(config, change.node), **{name: change.value})
    return replace(config, **{change.node: section})
