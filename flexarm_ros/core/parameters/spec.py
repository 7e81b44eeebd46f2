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

"""How a parameter is described: what is allowed for a key of a scenario, and what it means."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any


@dataclass(frozen=True)
class Spec:
    """
    What is allowed for one key, and what it means.

    ``kind`` is one of ``float``, ``int``, ``bool``, ``str``, ``float2`` (an
    array of two, one value a link or axis) and ``floats`` (any length from 1).
    ``low`` and ``high`` bound each value; ``low_open`` excludes the bound
    itself.  ``choices`` lists the allowed texts.  ``live`` marks what may be
    changed while a run goes on (at a tick boundary).  ``whole_ns`` marks a
    time whose decimal text times 1e9 must be an integer.
    """

    kind: str
    unit: str
    doc: str
    paper: str = ''
    low: float | None = None
    high: float | None = None
    low_open: bool = False
    choices: tuple[str, ...] = ()
    live: bool = False
    whole_ns: bool = False


def parameter(default: Any, kind: str, unit: str, doc: str, **rest: Any) -> Any:
    """Return the field of a key: its default, and its :class:`Spec` from the rest."""
    key = rest.pop('key', None)
    spec = Spec(kind, unit, doc, **rest)
    return field(default=default, metadata={'spec': spec, 'key': key})


def specs(section: type) -> dict[str, tuple[str, Spec, Any]]:
    """Return ``{key in the file: (field name, Spec, default)}`` of a section's class."""
    return {
        f.metadata['key'] or f.name: (f.name, f.metadata['spec'], f.default)
        for f in fields(section)
    }
