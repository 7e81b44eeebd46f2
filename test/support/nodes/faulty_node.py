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
A node that does something bad at a tick: ``faulty_node.py ROLE FAULT TICK --ros-args ...``.

FAULT: ``raise`` (an exception in the callback of a tick), ``exit`` (leaves with status 0 as if
all were well), ``service`` (an exception in the callback of a service, as far as the node
itself is concerned), ``nan`` (a controller's law gives no number), ``import`` (dies
before it is a node), ``linger`` (does not leave when it is done, as Fast DDS keeps one from it now
and then).
"""

from __future__ import annotations

import os
import sys
import time
from typing import Any


def faulty(kind: type[Any], role: str, fault: str, tick: int) -> type[Any]:
    """Return the node's class with the fault in it."""
    from flexarm_ros.nodes.runtime.topics.graph import TICK_EVERY

    class Faulty(kind):  # type: ignore[misc]
        """The node with the fault."""

        def advance(self, *args: Any) -> bool:
            self._strike()
            return bool(super().advance(*args))

        def advance_fast(self, *args: Any) -> None:
            self._fast_now = True  # as far as the tick of the fault
            try:
                super().advance_fast(*args)
            finally:
                self._fast_now = False

        @property
        def final_tick(self) -> int:
            final = int(super().final_tick)
            return min(final, tick) if getattr(self, '_fast_now', False) else final

        def check_end(self) -> None:
            if role == 'recorder':  # a batch of ticks may have been the rest of the run
                self._strike()
            super().check_end()

        def _strike(self) -> None:
            if self._strikes():
                strike(self, fault)

        def _strikes(self) -> bool:
            if role != 'trajectory':
                return bool(self.tick >= tick)
            # It hears of the plant's ticks now and then, and is far ahead of them itself.
            return self._reached.ticks > 0 and tick < self._reached.ticks + TICK_EVERY

    return Faulty


def strike(node: Any, fault: str) -> None:
    """Let the fault happen."""
    if fault == 'raise':
        raise ZeroDivisionError('a fault on purpose')
    if fault == 'exit':
        os._exit(0)  # SystemExit is reported as an error
    if fault == 'nan':
        node._part.answer = lambda *_: (float('nan'), 0.0)
    else:
        node.crashed = 'ZeroDivisionError: a fault on purpose'


def main() -> int:
    """Start the node that ``sys.argv`` names, with its fault."""
    role, fault, tick = sys.argv[1], sys.argv[2], int(sys.argv[3])
    if fault == 'import':
        raise ImportError('no such module, on purpose')
    from flexarm_ros.nodes import process
    from rclpy.node import Node

    if fault == 'linger':
        Node.destroy_node = lambda _: time.sleep(60.0)  # type: ignore[method-assign]
        return process.run_process(role, sys.argv[4:])
    sound = process.node_class
    process.node_class = lambda name: faulty(sound(name), role, fault, tick)
    return process.run_process(role, sys.argv[4:])


if __name__ == '__main__':
    sys.exit(main())
