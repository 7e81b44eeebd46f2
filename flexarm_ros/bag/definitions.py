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
Definitions of message types, as a bag contains them.

They are those of the ``rosbags`` type store, so that a bag has the same bytes with and without
ROS.  To import the store takes 0.2 s: the definitions of this package's topics are in a file
that ``python -m flexarm_ros.bag.definitions [TYPE]...`` writes from it, with further types.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
import json
from pathlib import Path
import sys
from typing import NamedTuple

_FILE = Path(__file__).parent / 'assets' / 'definitions.json'


class Definition(NamedTuple):
    """The ``ros2msg`` text of a type with all nested definitions, and its RIHS01 hash."""

    text: str
    type_hash: str


@cache
def definition(type_name: str) -> Definition:
    """Return the definition of a type; KeyError if the type store has none."""
    found = kept().get(type_name)
    return from_store(type_name) if found is None else found


def from_store(type_name: str) -> Definition:
    """Return the definition of a type as the type store has it."""
    from flexarm_ros.wire.generic_decode import typestore

    text, _ = typestore().generate_msgdef(type_name, ros_version=2)
    return Definition(text, typestore().hash_rihs01(type_name))


@cache
def kept() -> dict[str, Definition]:
    """Return the definitions in the file."""
    found = json.loads(_FILE.read_text(encoding='utf-8'))
    return {type_name: Definition(*parts) for type_name, parts in found.items()}


def _write(type_names: Iterable[str]) -> None:
    """Write the file anew, for the types that it has and ``type_names``."""
    names = sorted({*(kept() if _FILE.exists() else ()), *type_names})
    found = {name: from_store(name) for name in names}
    _FILE.parent.mkdir(exist_ok=True)
    _FILE.write_text(json.dumps(found, indent=1) + '\n', encoding='utf-8')


if __name__ == '__main__':
    _write(sys.argv[1:])
