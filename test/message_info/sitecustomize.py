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
A stand-in for other middlewares: what a received message's info tells, in every process.

Python imports this module at its start where this directory is on PYTHONPATH.  The variable
FLEXARM_TEST_MESSAGE_INFO lists what is to be changed:

- ``none``: no ``publisher_gid``, as with rclpy of Jazzy;
- ``handle``: bytes of this process only in its place, as with Cyclone DDS;
- ``deaf``: no message comes at all, a node's own included;
- ``unnumbered``: no ``publication_sequence_number``, as with several middlewares.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
import hashlib
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
import os
import sys
from types import ModuleType
from typing import Any

VARIABLE = 'FLEXARM_TEST_MESSAGE_INFO'
APART = 'FLEXARM_TEST_APART'
_SALT = os.urandom(16)


@cache
def handle(gid: bytes) -> bytes:
    """Return bytes that stand for a publisher in this process."""
    return hashlib.blake2b(gid, key=_SALT, digest_size=16).digest()


def patch(subscription: Any, wanted: Sequence[str]) -> None:
    """Change what rclpy's class ``subscription`` tells of messages that it takes."""
    take: Callable[..., Any] = subscription.take_message

    def take_message(self: Any, *words: Any) -> Any:
        taken = None if 'deaf' in wanted else take(self, *words)
        if taken is not None:
            info = taken[1]
            if 'none' in wanted:
                info.pop('publisher_gid', None)
            elif 'handle' in wanted and 'publisher_gid' in info:
                sender = info['publisher_gid']
                sender['data'] = handle(bytes(sender['data']))
            if 'unnumbered' in wanted:
                info['publication_sequence_number'] = None
        return taken

    subscription.take_message = take_message


def patch_count(subscription: Any) -> None:
    """Let ``subscription`` show no publisher while the file named by `APART` is there."""
    count: Callable[..., int] = subscription.get_publisher_count

    def get_publisher_count(self: Any) -> int:
        apart = os.environ.get(APART, '')
        return 0 if apart and os.path.exists(apart) else count(self)

    subscription.get_publisher_count = get_publisher_count


class _AfterImport(MetaPathFinder):
    """Patches rclpy's subscriptions as soon as they are imported."""

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name != 'rclpy.subscription':
            return None
        sys.meta_path.remove(self)
        spec = find_spec(name)
        assert spec is not None
        assert spec.loader is not None
        execute = spec.loader.exec_module

        def exec_module(module: ModuleType) -> None:
            execute(module)
            implementation = sys.modules['rclpy.impl.implementation_singleton']
            patch(implementation.rclpy_implementation.Subscription, _wanted())
            patch_count(implementation.rclpy_implementation.Subscription)

        spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec


def _wanted() -> list[str]:
    return os.environ.get(VARIABLE, '').split()


if _wanted() or APART in os.environ:
    sys.meta_path.insert(0, _AfterImport())
