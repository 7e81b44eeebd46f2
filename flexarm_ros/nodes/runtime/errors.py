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

"""Errors that end a run."""

from __future__ import annotations


class RunFailed(Exception):
    """
    The run cannot continue; ``blame`` is the role that caused it, empty if unknown.

    ``reported_by`` is the role that detected it, empty if it was this node.
    """

    def __init__(self, blame: str, reason: str, reported_by: str = '') -> None:
        super().__init__(reason)
        self.blame = blame
        self.reason = reason
        self.reported_by = reported_by


class NeverMet(RunFailed):
    """The run did not begin because the middleware did not connect its nodes."""
