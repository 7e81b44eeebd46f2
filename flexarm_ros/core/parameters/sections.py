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
Every parameter of a run: name, type, unit, default, range and description.

This is the single definition of a scenario's keys.  The scenario reader checks files against it,
the nodes declare their ROS parameters from it, and docs/reference/parameters.md is generated
from it.  A class is a node's section; a field is a key.  ``key`` in a field's metadata gives the
name in the file if it differs from the field's (a law's gain, ``lqg.horizon``).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

from flexarm_ros.core.parameters.changes import Change
from flexarm_ros.core.parameters.channel import ChannelParameters, LONGEST_S
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
    'is_optional',
    'keys',
    'made',
    'specs',
    'values_of',
    'with_section',
]


class OwnLaw(NamedTuple):
    """A law from outside this package: its keys are ``controller.PREFIX.KEY``."""

    prefix: str
    parameters: type
    """A frozen dataclass of `flexarm_ros.core.parameters.spec.parameter` fields."""


OWN_LAWS: dict[str, OwnLaw] = {}
"""``controller.law`` -> a law from outside this package that has been registered."""


@dataclass(frozen=True)
class RunParameters:
    """Section ``/**``: parameters of the run as a whole."""

    control_period: float = _key(
        0.001, 'float', 's', 'control period, one tick', low=0.0, low_open=True,
        high=3600.0, whole_ns=True, paper='0.001',
    )  # fmt: skip
    duration: float = _key(
        16.0, 'float', 's', 'simulated time of the run, an integer number of ticks', low=0.0,
        low_open=True, high=1.0e7, whole_ns=True, paper='16.0',
    )  # fmt: skip
    sync: str = _key(
        'lockstep', 'str', '', 'lockstep: barrier at every tick; free: paced by the wall clock',
        choices=('lockstep', 'free'),
    )  # fmt: skip
    seed: int = _key(0, 'int', '', 'seed of every noise source', low=0, high=2**31 - 1)
    record: bool = _key(True, 'bool', '', 'true: wait for a recorder; false: run without one')
    start_timeout: float = _key(
        60.0, 'float', 's', 'timeout for participants to join, wall time', low=0.1, high=86400.0
    )
    tick_timeout: float = _key(
        5.0, 'float', 's', 'timeout for participants to answer a tick, wall time',
        low=0.01, high=86400.0,
    )  # fmt: skip
    on_invalid: str = _key(
        'error', 'str', '', 'error: an invalid message ends the run; ignore: it is counted',
        choices=('error', 'ignore'),
    )  # fmt: skip
    clock_rate: float | None = _key(
        None, 'float', 'Hz', 'rate of `/clock`, an integer number of ticks per message, the first '
        'at tick 0; 0 or not set: every tick', low=0.0, high=1e9,
    )  # fmt: skip


@dataclass(frozen=True)
class PlantParameters:
    """Section ``plant``: the arm."""

    model: str = _key(
        'eq14', 'str', '',
        'eq14: equation (14) as printed, rigid Coriolis terms only; full: all inertia terms '
        'and the foreshortening of the links',
        choices=('eq14', 'full'), paper='eq14',
    )  # fmt: skip
    modes: int = _key(1, 'int', '', 'assumed modes per link', low=1, high=6, paper='1')
    basis: str = _key(
        'arm_modes', 'str', '',
        'shape functions of the full model: arm_modes: fitted to the modes of this arm; '
        'craig_bampton: static shapes and clamped modes; clamped_free: cantilever modes',
        choices=('arm_modes', 'craig_bampton', 'clamped_free'),
    )  # fmt: skip
    length: tuple[float, float] = _key(
        (4.5, 4.5), 'float2', 'm', 'length of the flexible part of each link', low=0.0,
        low_open=True, high=1e4, paper='4.5',
    )  # fmt: skip
    hub_radius: tuple[float, float] = _key(
        (0.0, 0.0), 'float2', 'm', 'length of the rigid, massless part of each link between its '
        'joint and its flexible part', low=0.0, high=1e4,
    )  # fmt: skip
    end_offset: tuple[float, float] = _key(
        (0.0, 0.0), 'float2', 'm', 'length of the rigid, massless part of each link between its '
        'flexible part and the next joint or the tip', low=0.0, high=1e4,
    )  # fmt: skip
    mass_density: tuple[float, float] = _key(
        (0.335, 0.335), 'float2', 'kg/m', 'mass per metre of each link', low=0.0, low_open=True,
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
    link_damping: tuple[float, float] = _key(
        (0.0, 0.0), 'float2', 'N m s/rad', 'material (Kelvin-Voigt) damping of each link: root '
        'moment per rate of the angle deflection / length, beside damping_ratio', low=0.0,
        high=1e9,
    )  # fmt: skip
    viscous_friction: tuple[float, float] = _key(
        (0.0, 0.0), 'float2', 'N m s/rad', 'viscous friction of each joint', low=0.0, high=1e9
    )
    coulomb_friction: tuple[float, float] = _key(
        (0.0, 0.0), 'float2', 'N m', 'Coulomb friction of each joint, also the torque that breaks '
        'it away from rest', low=0.0, high=1e9,
    )  # fmt: skip
    coulomb_friction_negative: tuple[float, float] | None = _key(
        None, 'float2', 'N m', 'Coulomb friction of each joint at negative rates; default: '
        'coulomb_friction', low=0.0, high=1e9,
    )  # fmt: skip
    substeps: int | None = _key(
        None, 'int', '', 'integration steps per tick; default: from the highest frequency',
        low=1, high=100000,
    )  # fmt: skip
    deflection_limit: tuple[float, float] | None = _key(
        None, 'float2', 'm', 'end deflection of each link beyond which the run is unstable; '
        'default: 10/9 of the length of each link',
        low=0.0, low_open=True, high=1e5, paper='5',
    )  # fmt: skip
    initial_position: tuple[float, float] | None = _key(
        None, 'float2', 'rad', 'initial joint angles; default: on the reference',
        low=-1e4, high=1e4,
    )  # fmt: skip
    initial_velocity: tuple[float, float] | None = _key(
        None, 'float2', 'rad/s', 'initial joint rates; default: at rest', low=-1e4, high=1e4
    )
    command_hold: float = _key(
        0.5, 'float', 's', 'with `sync: free`, time for which the last torque is held if no new '
        'one arrives; then `plant.command_loss` applies', low=0.0, high=1e7,
    )  # fmt: skip
    command_loss: str = _key(
        'end', 'str', '', 'with `sync: free`, end: the run ends if no torque has arrived for '
        '`plant.command_hold`; zero: zero torque until the next one arrives',
        choices=('end', 'zero'),
    )  # fmt: skip

    @property
    def spans(self) -> tuple[float, float]:
        """Return the distances shoulder to elbow and elbow to tip, m, of straight links."""
        hubs, lengths, ends = self.hub_radius, self.length, self.end_offset
        return hubs[0] + lengths[0] + ends[0], hubs[1] + lengths[1] + ends[1]

    @property
    def reach(self) -> float:
        """Return the distance shoulder to tip, m, of a straight arm."""
        return self.spans[0] + self.spans[1]

    def flexible_part(self, link: int, distance: float) -> tuple[float, float]:
        """
        Split a distance, m, from the joint of ``link`` (0 or 1).

        Returns its part along the flexible length and that beyond the flexible length.
        """
        past_hub = distance - self.hub_radius[link]
        bent = min(max(past_hub, 0.0), self.length[link])
        return bent, max(past_hub - bent, 0.0)


@dataclass(frozen=True)
class EncoderParameters(ChannelParameters):
    """Section ``encoder``: the joint encoders."""

    resolution: float = _key(
        0.0, 'float', 'rad', 'angle of one count; 0: ideal', low=0.0, high=1.0, live=True
    )
    noise_std: float = _key(
        0.0, 'float', 'rad', 'standard deviation of the angle noise', low=0.0, high=1.0, live=True
    )
    offset: tuple[float, float] = _key(
        (0.0, 0.0), 'float2', 'rad', 'reading of each encoder at angle zero', low=-1e4, high=1e4
    )


@dataclass(frozen=True)
class TipSensorParameters(ChannelParameters):
    """Section ``tip_sensor``: the position sensor on link 2."""

    location: float = _key(
        9.0, 'float', 'm', 'location from the shoulder along the arm, between elbow and tip',
        low=0.0, high=2e4, paper='9.0 or 6.75',
    )  # fmt: skip
    more_locations: tuple[float, ...] | None = _key(
        None, 'floats', 'm', 'locations of further sensors, between elbow and tip, recorded only: '
        'like the first, with their own noise, on `tip_sensor/odometry_1` and so on',
        low=0.0, high=2e4,
    )  # fmt: skip
    measurand: str = _key(
        'rigid', 'str', '', 'rigid: kinematics of the joint angles (Figure 4); elastic: point of '
        'the bent arm',
        choices=('rigid', 'elastic'),
    )  # fmt: skip
    latency: float = _key(
        0.0, 'float', 's', 'age of a measurement at delivery', low=0.0, high=LONGEST_S,
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
        4.0, 'float', 's', 'duration of one side', low=0.0, low_open=True, high=1e7, whole_ns=True,
        paper='4.0',
    )  # fmt: skip
    delay: float = _key(
        0.0, 'float', 's', 'delay of the reference (the forward-loop correction)', low=0.0,
        high=1e4, whole_ns=True, live=True, paper='0',
    )  # fmt: skip
    hold_position: tuple[float, float] | None = _key(
        None, 'float2', 'm', 'x, y to hold; default: the end effector of the initial pose, or the '
        "square's lower left corner",
        low=-1e5, high=1e5,
    )  # fmt: skip
    waypoint_times: tuple[float, ...] | None = _key(
        None, 'floats', 's', 'ascending times of the way points, the first 0', low=0.0, high=1e7,
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
    """Choice of the control law, and parameters of the paper's laws."""

    law: str = _key(
        'fls', 'str', '', 'control law: pd is (20), fls is (21); inverse, passive, lqg, '
        'adaptive: see docs/controllers.md; or the name of an installed law, or '
        'package.module:Class',
        choices=('pd', 'fls', 'open_loop', 'inverse', 'passive', 'lqg', 'adaptive'),
    )  # fmt: skip
    feedback: str = _key(
        'tip_sensor', 'str', '', 'sensor that closes the loop', choices=('encoder', 'tip_sensor')
    )
    velocity_source: str = _key(
        'feedback', 'str', '', 'feedback: rates as measured with the position; encoder: '
        'undelayed joint rates',
        choices=('feedback', 'encoder'),
    )  # fmt: skip
    deflection_source: str = _key(
        'plant', 'str', '', 'end deflections that the law uses; plant: exact, undelayed; '
        'strain_gauge: those that the readings of the strain gauges stand for',
        choices=('plant', 'strain_gauge'), paper='plant',
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
        None, 'str', '', 'CSV t,tau1,tau2 for law open_loop; path relative to the scenario'
    )
    torque_limit: float = _key(
        0.0, 'float', 'N m', 'torque limit of each joint; 0: none', low=0.0, high=1e9, live=True
    )
    rate: float = _key(
        0.0, 'float', 'Hz', 'rate at which the law is computed, an integer number of ticks per '
        'torque, which is held in between; 0: every tick', low=0.0, high=1e9,
    )  # fmt: skip
    compute_delay: float = _key(
        0.0, 'float', 's', 'time from the sample to the torque that is computed from it; the '
        'torque changes at the first tick at or after that', low=0.0, high=LONGEST_S,
        whole_ns=True,
    )  # fmt: skip


@dataclass(frozen=True)
class ControllerParameters(PlanningParameters, FeedbackParameters):
    """
    Section ``controller``: the control law and its gains.

    ``laws``: ``(prefix, parameters)`` of laws from outside this package that are not at their
    defaults.
    """

    laws: tuple[tuple[str, Any], ...] = ()

    def own(self, law: str = '') -> Any:
        """Return the parameters of the registered ``law``, by default of this law, or None."""
        found = OWN_LAWS.get(law or self.law)
        if found is None:
            return None
        held = dict(self.laws)
        return held[found.prefix] if found.prefix in held else found.parameters()


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
"""Section name in a scenario file -> class of its keys; those of optional parts are last."""


@dataclass(frozen=True)
class PaceParameters:
    """
    Pacing of a run's nodes: in section ``/**`` or ``plant``, and parameters of the plant.

    They do not affect the numbers of a run: a simulation ignores them, and no bag records them.
    """

    real_time_factor: float = _key(
        0.0, 'float', '', 'limit the run to this multiple of real time; 0: no limit',
        low=0.0, high=1e6, live=True,
    )  # fmt: skip
    step_ticks: int = _key(
        1, 'int', '', 'ticks of a paused run per call of the service `plant/step`', low=1,
        high=10**9, live=True,
    )  # fmt: skip
    start_paused: bool = _key(
        False, 'bool', '', 'the nodes of a run wait before tick 0 for the service `plant/pause` '
        '(data: false) or `plant/step`',
    )  # fmt: skip
    realtime_priority: int = _key(
        10, 'int', '', 'with `sync: free`, SCHED_FIFO priority that the plant requests for '
        'its loop, and half of it for the nodes but the recorder; 0: none', low=0, high=99,
    )  # fmt: skip
    realtime_cpu: int = _key(
        -1, 'int', '', 'with `sync: free`, number of the CPU that the plant binds its loop to; '
        '-1: any', low=-1, high=4095,
    )  # fmt: skip
    lock_memory: bool = _key(
        True, 'bool', '', "with `sync: free`, the plant's process requests that its memory is "
        'not paged out (mlockall)',
    )  # fmt: skip


@dataclass(frozen=True)
class RunConfig:
    """
    A complete, checked scenario, used by all layers.

    ``torques`` holds the rows of the torque file, shape ``(rows, 3)`` as
    nested tuples ``(t, tau1, tau2)``, empty unless the law is ``open_loop``.
    ``further`` holds ``(section, parameters)`` of the optional parts that take part, in order of
    names; see `section`.  ``changes`` are the live parameters that were set during a recorded
    run; a scenario file has none.  ``pace`` does not affect the numbers of the run and is not
    recorded.
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
    further: tuple[tuple[str, Any], ...] = ()

    def section(self, name: str) -> Any:
        """Return a section by its name in a file, None for an optional one that is absent."""
        if name in _FIELDS:
            return getattr(self, _FIELDS[name])
        return dict(self.further).get(name)


_FIELDS = {'/**': 'run'} | {f.name: f.name for f in fields(RunConfig) if f.name in SECTIONS}
"""Section of the required parts and of the run -> field of `RunConfig`."""


def is_optional(section: str) -> bool:
    """Return whether a section belongs to a part that a scenario may do without."""
    return section not in _FIELDS


def with_section(config: RunConfig, section: str, held: Any) -> RunConfig:
    """Return ``config`` with one section replaced, or with that of an optional part."""
    if section in _FIELDS:
        return replace(config, **{_FIELDS[section]: held})
    rest = {**dict(config.further), section: held}
    return replace(config, further=tuple(sorted(rest.items())))


def _own_laws() -> Iterator[tuple[str, OwnLaw]]:
    """Yield each prefix of the registered laws once, with a law that has it."""
    yield from {own.prefix: own for own in OWN_LAWS.values()}.items()


def keys(section: str) -> dict[str, tuple[str, Spec, Any]]:
    """
    Return ``{key: (field name, Spec, default)}`` of a section, as `specs` does.

    Those of registered laws are in it, and their names among the choices of ``controller.law``.
    """
    known = specs(SECTIONS[section])
    if section != 'controller' or not OWN_LAWS:
        return known
    name, law, default = known['law']
    known['law'] = name, replace(law, choices=(*law.choices, *OWN_LAWS)), default
    for prefix, own in _own_laws():
        known.update({f'{prefix}.{key}': entry for key, entry in specs(own.parameters).items()})
    return known


def values_of(config: RunConfig, section: str) -> dict[str, Any]:
    """
    Return ``{key: value}`` of a section.

    A registered law's keys are included if it is the law or one of them differs from its default;
    an absent optional section has none.
    """
    held = config.section(section)
    if held is None:
        return {}
    values = {key: getattr(held, name) for key, (name, _, _) in specs(SECTIONS[section]).items()}
    if section == 'controller':
        told = dict(held.laws)
        if held.law in OWN_LAWS:
            told.setdefault(OWN_LAWS[held.law].prefix, held.own())
        for prefix, own in told.items():
            own_keys = specs(type(own)).items()
            values.update(
                {f'{prefix}.{key}': getattr(own, name) for key, (name, _, _) in own_keys}
            )
    return values


def made(section: str, values: Mapping[str, Any]) -> Any:
    """Return a section from its ``{key: value}``; ``KeyError`` for an unknown key."""
    known, left = specs(SECTIONS[section]), dict(values)
    fields = {name: left.pop(key) for key, (name, _, _) in known.items() if key in left}
    laws = []
    for prefix, own in _own_laws() if section == 'controller' else ():
        entries = specs(own.parameters).items()
        given = {
            name: left.pop(f'{prefix}.{key}')
            for key, (name, _, _) in entries
            if f'{prefix}.{key}' in left
        }
        parameters = own.parameters(**given)
        if parameters != own.parameters():
            laws.append((prefix, parameters))
    if left:
        raise KeyError(f'{section}.{next(iter(left))}')
    if laws:
        fields['laws'] = tuple(laws)
    return SECTIONS[section](**fields)


def changed(config: RunConfig, change: Change) -> RunConfig:
    """Return ``config`` with a live parameter set; ``KeyError`` if there is none."""
    _, spec, _ = keys(change.node)[change.key]
    if not spec.live:
        raise KeyError(f'{change.node}.{change.key}')
    values = {**values_of(config, change.node), change.key: change.value}
    return with_section(config, change.node, made(change.node, values))
