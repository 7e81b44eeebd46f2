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

"""A small arm with strain gauges, as rigs have it, for the tests of recordings."""

PERIOD = 0.002
ARM = """
/**:
  ros__parameters: {control_period: 0.002, duration: 4.0}
plant:
  ros__parameters:
    model: full
    modes: 1
    basis: craig_bampton
    length: [0.202, 0.20185]
    hub_radius: [0.079, 0.079]
    mass_density: [0.76, 0.266]
    flexural_rigidity: [1.44, 0.256]
    link_damping: [0.03, 0.004]
    hub_inertia: [0.0635, 0.003]
    link_end_mass: 1.8
    payload_mass: 0.157
    initial_position: [0.0, 0.0]
tip_sensor:
  ros__parameters: {location: 0.5}
trajectory:
  ros__parameters: {kind: hold}
controller:
  ros__parameters: {law: pd, feedback: encoder}
strain_gauge:
  ros__parameters:
    gain: [0.57, 0.88]
    offset: [0.001, -0.002]
    offset_slope: [-0.004, 0.0]
    filter_cutoff: [4.0, 4.0]
    filter_damping: [0.9, 0.9]
"""
