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
Checks across the keys of a scenario, beyond the Spec of each key.

The core checks the conditions of its formulas (:mod:`flexarm_ros.core.run.checks`); here are the
limits for files from untrusted sources.  Errors name the key, the value and what is allowed.
"""

from __future__ import annotations

from flexarm_ros.core.parameters.sections import RunConfig, SECTIONS, values_of
from flexarm_ros.core.parameters.spec import exact_ns
from flexarm_ros.scenario.errors import clip, ScenarioError

MAX_BUFFER_TICKS = 1_000_000
"""Longest latency in ticks, the number of past values that a sensor keeps."""

MAX_SUBSTEPS = 100_000
"""Most integration steps per tick that are chosen if ``plant.substeps`` is not set."""


def check(config: RunConfig) -> None:
    """Raise ScenarioError if the parts of ``config`` are inconsistent."""
    _check_buffers(config)
    _check_torques(config)
    _check_model(config)


def _check_buffers(config: RunConfig) -> None:
    period = exact_ns(repr(config.run.control_period)) or 1
    for section in SECTIONS:
        latency = values_of(config, section).get('latency', 0.0)
        if (exact_ns(repr(latency)) or 0) > MAX_BUFFER_TICKS * period:
            raise ScenarioError(
                f'{section}.latency: {latency!r} s is more than {MAX_BUFFER_TICKS} ticks of '
                f'{config.run.control_period!r} s (/**.control_period)'
            )


def _check_torques(config: RunConfig) -> None:
    if config.controller.law == 'open_loop' and not config.torques:
        given = config.controller.torque_file is not None
        raise ScenarioError(
            f'controller.torque_file: {"its contents were not supplied" if given else "missing"}; '
            "law 'open_loop' needs a CSV file t,tau1,tau2"
        )


def _check_model(config: RunConfig) -> None:
    """Check the model by the core, and limit its integration steps."""
    # Imported here: compiled code takes half a second to import, and the errors above need none.
    from flexarm_ros.core.run import checks
    from flexarm_ros.core.run.make_plant import choose_integrator, highest_frequency
    import numpy as np

    try:
        with np.errstate(all='ignore'):
            checks.check(config)
            highest = highest_frequency(config)
            _, substeps = choose_integrator(config)
    except ValueError as error:
        raise ScenarioError(clip(str(error), 400)) from None
    except (ArithmeticError, MemoryError) as error:
        raise ScenarioError(f'plant: no finite model of these parameters ({error})') from None
    if substeps > MAX_SUBSTEPS:
        raise ScenarioError(
            f'plant.substeps: not set, and {substeps:.3g} would be needed for a highest '
            f'frequency of {highest:.4g} rad/s; at most {MAX_SUBSTEPS}: take a shorter '
            '/**.control_period'
        )
