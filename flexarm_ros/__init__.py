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
A two-link flexible space robot simulated as lock-stepped ROS 2 nodes; see README.md.

For notebooks and scripts, without ROS::

    import flexarm_ros as fa

    run = fa.simulate("fls_tip", plant={"hub_inertia": [10, 10]})
    run.trajectory["theta1"], run.summary["rms_error"], run.plot()

The names in ``__all__`` are stable. Each is loaded on first use, so that importing the package
itself is cheap.
"""

from __future__ import annotations

from typing import Any, TYPE_CHECKING

from flexarm_ros.api.gymnasium_ids import register_ids

if TYPE_CHECKING:
    from flexarm_ros.api.environment import FlexArmEnv
    from flexarm_ros.api.identify import fit, predict
    from flexarm_ros.api.linear import linear_law, linearize
    from flexarm_ros.api.pictures import plot, report
    from flexarm_ros.api.run import load, Run
    from flexarm_ros.api.simulation import configure, simulate
    from flexarm_ros.scenario import ScenarioError

__all__ = [
    'FlexArmEnv',
    'Run',
    'ScenarioError',
    'configure',
    'fit',
    'linear_law',
    'linearize',
    'load',
    'plot',
    'predict',
    'report',
    'simulate',
]

_HOMES = {
    'FlexArmEnv': 'flexarm_ros.api.environment',
    'Run': 'flexarm_ros.api.run',
    'ScenarioError': 'flexarm_ros.scenario',
    'configure': 'flexarm_ros.api.simulation',
    'fit': 'flexarm_ros.api.identify',
    'linear_law': 'flexarm_ros.api.linear',
    'linearize': 'flexarm_ros.api.linear',
    'load': 'flexarm_ros.api.run',
    'plot': 'flexarm_ros.api.pictures',
    'predict': 'flexarm_ros.api.identify',
    'report': 'flexarm_ros.api.pictures',
    'simulate': 'flexarm_ros.api.simulation',
}


def __getattr__(name: str) -> Any:
    """Load a name of the API from its module on first use (PEP 562)."""
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    from importlib import import_module

    value = getattr(import_module(home), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


register_ids()
