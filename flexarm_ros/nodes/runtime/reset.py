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
Starting a run again in the same graph: every node at tick 0, no old message taken.

The plant announces a new epoch by its status.  Each node then delivers what it
has sent, rebuilds its part and says so; when it sees that all have, the last
message of the old epoch is in the queues, so it empties them and is ready.
The new run's bytes are those of a fresh one.
"""

from __future__ import annotations

from flexarm_ros.nodes.runtime.joining.membership import Membership
from flexarm_ros.nodes.runtime.joining.status import EPOCH, epoch_of, PLANT


class Epochs:
    """Which run of its graph a participant is in."""

    def __init__(self, membership: Membership) -> None:
        self._membership = membership
        self.number = 0

    def extra(self, **more: str) -> dict[str, str]:
        """Return what the status says beside the phase."""
        plant = self._membership.status_of('plant')
        return {EPOCH: str(self.number), PLANT: plant.identity if plant else '', **more}

    def announced(self) -> bool:
        """Whether the plant is in a later epoch than this node."""
        return epoch_of(self._membership.status_of('plant')) > self.number

    def left_by_all(self) -> bool:
        """Whether every participant has left the epoch before this one."""
        for role in self._membership.required():
            if role in self._membership.external:
                continue
            status = self._membership.status_of(role)
            if status is None or epoch_of(status) < self.number:
                return False
        return True
