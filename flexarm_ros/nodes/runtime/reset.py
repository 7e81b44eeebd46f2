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
Reset: a new run in the same graph, from tick 0 and without a message of the run before.

The plant announces a new epoch (a number) in its status.  Each node then waits until its messages
are delivered, builds its objects anew and publishes the epoch.  Once all nodes have done so, the
last message of the old epoch is in the queues; each node discards them and is ready.  The new run
has the bytes of a fresh one.
"""

from __future__ import annotations

from flexarm_ros.nodes.runtime.joining.membership import Membership
from flexarm_ros.nodes.runtime.joining.status import EPOCH, epoch_of, PLANT


class Epochs:
    """The number of the run that a participant takes part in, and the peers' numbers."""

    def __init__(self, membership: Membership) -> None:
        self._membership = membership
        self.number = 0
        self.constant: dict[str, str] = {}
        """Further values that the status always has."""

    def extra(self, **more: str) -> dict[str, str]:
        """Return the further values of the status."""
        plant = self._membership.status_of('plant')
        own = {EPOCH: str(self.number), PLANT: plant.identity if plant else ''}
        return {**own, **self.constant, **more}

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
