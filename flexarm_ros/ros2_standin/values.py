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

"""Messages as YAML and CSV, and back, as the real tools print and read them."""

from __future__ import annotations

import array
from collections.abc import Iterator
from importlib import import_module
from typing import Any

import numpy as np
import yaml


def interface(name: str, kind: str) -> Any:
    """Return the class of ``package/kind/Type`` or ``package/Type``; RuntimeError if none."""
    parts = name.split('/')
    if len(parts) == 2:
        parts.insert(1, kind)
    try:
        package, middle, base = parts
        if middle != kind:
            raise ValueError
        return getattr(import_module(f'{package}.{middle}'), base)
    except (AttributeError, ImportError, ValueError):
        what = {'msg': 'message', 'srv': 'service'}[kind]
        raise RuntimeError(f'The passed {what} type is invalid') from None


def plain(value: Any, limit: int | None = None, arrays: bool = True) -> Any:
    """Return a message as dictionaries, lists and numbers, long arrays cut after `limit`."""
    if hasattr(value, 'get_fields_and_field_types'):
        fields = ((name, getattr(value, name)) for name in value.get_fields_and_field_types())
        return {n: plain(v, limit, arrays) for n, v in fields if arrays or not is_array(v)}
    if isinstance(value, bytes):
        value = list(value)
    if is_array(value):
        items = [plain(item, limit, arrays) for item in value[:limit]]
        return items + ['...'] if limit is not None and len(value) > limit else items
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, str) and limit is not None and len(value) > limit:
        return value[:limit] + '...'
    return value


def is_array(value: Any) -> bool:
    """Return whether a field's value is an array or a sequence, strings not counted."""
    return isinstance(value, list | tuple | array.array | np.ndarray)


def as_yaml(value: Any, flow: bool = False) -> str:
    """Return plain values as the YAML that ``ros2 topic echo`` prints."""
    if not isinstance(value, dict | list):
        return f'{value}\n'
    return yaml.safe_dump(
        value, default_flow_style=flow, sort_keys=False, width=10**9, allow_unicode=True
    )


def leaves(value: Any) -> Iterator[Any]:
    """Yield the numbers and strings of plain values, in order of their fields."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        for item in value:
            yield from leaves(item)
    else:
        yield value


def field(message: Any, path: str) -> Any:
    """Return the field that a dotted path names, ``a.b[0].c``; RuntimeError if there is none."""
    names = [name for name in path.split('.') if name]
    if not names:
        raise RuntimeError(f"Invalid field value '{path}'")
    for name in names:
        base, _, index = name.partition('[')
        try:
            message = getattr(message, base)
            if index:
                message = message[int(index.rstrip(']'))]
        except (AttributeError, IndexError, ValueError):
            raise RuntimeError(f"Invalid field '{path}'") from None
    return message


def fill(message: Any, values: Any) -> None:
    """Set the fields of a message from parsed YAML; RuntimeError if one is invalid."""
    for name, value in (values or {}).items():
        try:
            current = getattr(message, name)
            if isinstance(value, dict):
                fill(current, value)
            else:
                wanted = type(current)
                number = wanted in (float, int) and isinstance(value, float | int)
                setattr(message, name, wanted(value) if number else value)
        except (AssertionError, AttributeError, TypeError) as error:
            raise RuntimeError(f'Failed to populate field: {error}') from None
