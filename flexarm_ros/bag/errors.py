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

"""Errors of bags and runs' directories."""

from __future__ import annotations


class BagError(Exception):
    """A bag or a run's directory that cannot be used; one line, fit to show a user."""


class BagExistsError(BagError):
    """The place where a bag should be written is taken."""


class BagMissingError(BagError):
    """The run that is named does not exist."""


class BagFormatError(BagError):
    """Bytes that are no MCAP bag, or a damaged one."""


class BagLimitError(BagError):
    """A bag that would need more memory than is allowed."""


class BagContentError(BagError):
    """A sound bag that is not a run of this package (topics, scenario, ticks)."""
