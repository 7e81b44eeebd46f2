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

"""Warnings in the processes of this package: shown, never errors."""

from __future__ import annotations

from typing import Any
import warnings


def allow_warnings() -> None:
    """
    Let no warning be raised as an exception in this process from now on; it is shown once.

    ``PYTHONWARNINGS=error`` is meant for a user's own code.  The dependencies warn too, in the
    middle of an import or of a call from C, where an exception ends a node.
    """
    filters: Any = [
        ('default' if action == 'error' else action, *rest) for action, *rest in warnings.filters
    ]
    warnings.resetwarnings()  # makes Python forget what it has decided for each module
    warnings.filters = filters
