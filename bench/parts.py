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

"""What each optional part or feature costs a tick, in one process."""

from __future__ import annotations

from bench.loop import in_turns, run_blocks, run_ticks
from bench.table import markdown, Part
from flexarm_ros import scenario
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.kernel import Kernel
from flexarm_ros.core.run.loop import ClosedLoop

TICKS = 2048
BASE = 'pd_tip'
FEATURES: dict[str, tuple[str, ...]] = {
    'nothing more': (),
    'noise and resolution of the encoder': (
        'encoder.noise_std=1e-5', 'encoder.resolution=1e-5',
    ),
    'noise of the tip sensor': ('tip_sensor.noise_std=1e-4',),
    'tip sensor at 100 Hz': ('tip_sensor.rate=100.0',),
    'delay as a Pade approximation': ('tip_sensor.latency_model=pade2',),
    'jitter of the tip sensor': ('tip_sensor.jitter=0.0005',),
    'exponential jitter, in order': (
        'tip_sensor.jitter=0.0005', 'tip_sensor.jitter_distribution=exponential',
        'tip_sensor.arrival=in_order',
    ),
    'measured latencies of the tip sensor': ('tip_sensor.latencies=[0.001, 0.0013, 0.0024]',),
    'dropout of the tip sensor': ('tip_sensor.dropout=0.02', 'tip_sensor.dropout_burst=3.0'),
    'encoder: latency, jitter, offset': (
        'encoder.latency=0.001', 'encoder.jitter=0.0005', 'encoder.offset=[0.001, 0.001]',
    ),
    'encoder at 500 Hz': ('encoder.rate=500.0',),
    'controller at 500 Hz': ('controller.rate=500.0',),
    'compute delay': ('controller.compute_delay=0.001',),
    'one further tip sensor': ('tip_sensor.more_locations=[6.75]',),
    'viscous and Coulomb friction': (
        'plant.viscous_friction=[0.5, 0.5]', 'plant.coulomb_friction=[1.0, 1.0]',
    ),
    'drives: bandwidth and saturation': (
        'actuator.bandwidth=[200.0, 200.0]', 'actuator.torque_limit=[2000.0, 2000.0]',
    ),
    'drives: efficiency and resolution': (
        'actuator.efficiency=[0.9, 0.9]', 'actuator.resolution=[0.01, 0.01]',
    ),
    'command: latency, jitter, dropout': (
        'actuator.latency=0.001', 'actuator.jitter=0.0005', 'actuator.dropout=0.02',
    ),
    'drives with backlash': ('actuator.backlash=[1e-4, 1e-4]',),
    'disturbance (no force)': ('disturbance.force_times=[0.0]', 'disturbance.force_x=[0.0]',
                               'disturbance.force_y=[0.0]'),
    'disturbance with a payload': (
        'disturbance.payload_times=[0.0]', 'disturbance.payload_masses=[0.1]',
    ),
    'strain gauges': ('strain_gauge.noise_std=1e-6',),
    'strain gauges with a low-pass, in the loop': (
        'strain_gauge.filter_cutoff=[20.0, 20.0]', 'strain_gauge.output=deflection',
        'controller.law=fls', 'controller.deflection_source=strain_gauge',
    ),
    'IMU': ('imu.accel_noise_density=1e-3',),
    'IMU at 500 Hz with walks of its biases': (
        'imu.accel_bias_walk=1e-3', 'imu.gyro_bias_walk=1e-4', 'imu.rate=500.0',
    ),
}  # fmt: skip
"""What it is -> assignments on top of `BASE`."""


def measure() -> Part:
    """Time a tick with each feature by itself, in blocks where the kernel has it."""
    rows, alone = [], 0.0
    for name, assignments in FEATURES.items():
        try:
            config = scenario.load(BASE, ['duration=2.5', *assignments])
        except scenario.ScenarioError as error:
            rows.append((name, '', '', f'not measured: {error}'.splitlines()[0]))
            continue
        blocks, single = cost(config)
        alone = alone or single
        rows.append((name, blocks, f'{single:.2f}', f'{single - alone:+.2f}'))
    head = ('feature', 'in blocks, us a tick', 'single ticks, us a tick', 'more, us')
    return Part('parts', [], [markdown(head, rows)])


def cost(config: RunConfig) -> tuple[str, float]:
    """Return the processor time of a tick, us: in blocks, if there is a kernel, and singly."""
    if Kernel.of(ClosedLoop(config)) is None:
        return '', in_turns(config, run_ticks, ticks=TICKS)[0]
    blocks, single = in_turns(config, run_blocks, run_ticks, ticks=TICKS)
    return f'{blocks:.2f}', single
