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
    Show warnings once instead of raising them as exceptions in this process.

    ``PYTHONWARNINGS=error`` is meant for a user's own code.  Dependencies warn too, during an
    import or a call from C, where an exception would end a node.
    """
    filters: Any = [
        ('default' if action == 'error' else action, *rest) for action, *rest in warnings.filters
    ]
    warnings.resetwarnings()  # discards the decisions that Python has stored per module
    warnings.filters = filters
