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

"""Errors of bags and output directories."""

from __future__ import annotations


class BagError(Exception):
    """A bag or an output directory cannot be used; one line for the user."""


class BagExistsError(BagError):
    """The path for a new bag exists already."""


class BagMissingError(BagError):
    """The named run does not exist."""


class UnknownRoleError(BagError):
    """An external role was named that the recorded run does not have."""


class BagFormatError(BagError):
    """The file is not an MCAP bag, or is damaged."""


class BagLimitError(BagError):
    """The bag would need more memory than allowed."""


class BagContentError(BagError):
    """The bag is intact but not a run of this package (topics, scenario, ticks)."""
