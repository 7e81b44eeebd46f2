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
The ids for ``gymnasium.make``: ``flexarm_ros/Square-v0`` and the others of ``IDS``.

Gymnasium 1.0 dropped entry points for environments, so importing this package registers the
ids.  It does not import Gymnasium: if that is not imported yet, the ids are registered when it
is.
"""

from __future__ import annotations

from importlib.machinery import ModuleSpec
from importlib.util import find_spec
import sys
from types import ModuleType
from typing import Any

IDS = {
    'Square-v0': 'fls_tip',
    'SquarePhysicalDelay-v0': 'fls_tip_physical',
    'SquareElastic-v0': 'fls_tip_elastic',
}
"""Name in the namespace ``flexarm_ros`` -> default scenario of ``make``."""

GYMNASIUM = 'gymnasium'


def register_ids() -> None:
    """Register the ids now if Gymnasium is imported, else once it is."""
    if GYMNASIUM in sys.modules:
        _register(sys.modules[GYMNASIUM])
    else:
        sys.meta_path.insert(0, _WhenImported())


def _register(gymnasium: ModuleType) -> None:
    """Register the ids that are not registered yet."""
    register = getattr(gymnasium, 'register', None)
    if register is None:  # not installed, or partially imported
        return
    for name, scenario in IDS.items():
        if f'flexarm_ros/{name}' not in gymnasium.registry:
            register(
                f'flexarm_ros/{name}',
                entry_point='flexarm_ros.api.environment:FlexArmEnv',
                kwargs={'scenario': scenario},
            )


class _WhenImported:
    """An import finder that registers the ids after the import of Gymnasium."""

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """Return Gymnasium's spec with a registering loader; None for any other module."""
        if name != GYMNASIUM:
            return None
        sys.meta_path.remove(self)
        spec = find_spec(name)
        if spec is None or spec.loader is None:
            sys.meta_path.insert(0, self)
            return None
        run = spec.loader.exec_module

        def run_and_register(module: ModuleType) -> None:
            run(module)
            _register(module)

        spec.loader.exec_module = run_and_register  # type: ignore[method-assign]
        return spec
