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
YAML as rcl's parameter parser reads it, and a writer whose output rcl and PyYAML read alike.

rcl determines the type of a scalar with ``strtoll`` and ``strtod`` (rcl_yaml_param_parser,
``get_value``), not by the rules of YAML: ``1e-3`` and ``0x1p-3`` are numbers, ``010`` is 8,
``1_000`` and ``null`` are strings.  Aliases and empty values are not supported.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import json
import re
import sys
from typing import Any

from flexarm_ros.scenario.errors import clip, ScenarioError
import yaml

MAX_DEPTH = 16
"""Deepest nesting of maps and arrays that is read; a scenario needs about five."""

MAX_NODES = 100_000
"""Largest number of values of a document, to limit the time of reading."""

PlainValue = bool | int | float | str

_BOOLS = {
    **dict.fromkeys(
        ('Y', 'y', 'yes', 'Yes', 'YES', 'true', 'True', 'TRUE', 'on', 'On', 'ON'), True
    ),
    **dict.fromkeys(
        ('N', 'n', 'no', 'No', 'NO', 'false', 'False', 'FALSE', 'off', 'Off', 'OFF'), False
    ),
}
_SPECIAL = re.compile(r'(?:[+-]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))')
_SPACE = r'[ \t\n\v\f\r]*'
_INTEGER = re.compile(_SPACE + r'([+-]?)(?:0[xX]([0-9a-fA-F]+)|(0[0-7]*)|([1-9][0-9]*))')
_DECIMAL = re.compile(_SPACE + r'[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?')
_HEX_FLOAT = re.compile(
    _SPACE + r'([+-]?0[xX](?:[0-9a-fA-F]+\.?[0-9a-fA-F]*|\.[0-9a-fA-F]+))([pP][+-]?[0-9]+)?'
)
_WORD = re.compile(_SPACE + r'([+-]?)(?:(inf|infinity)|nan(?:\([0-9A-Za-z_]*\))?)', re.IGNORECASE)

_CParser: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)


@dataclass(frozen=True, slots=True)
class Scalar:
    """A value, its text as written, and its line (0: not from a file)."""

    value: PlainValue
    text: str
    line: int = 0


@dataclass(frozen=True, slots=True)
class SequenceTree:
    """An array."""

    items: tuple[Tree, ...]
    line: int = 0


@dataclass(frozen=True, slots=True)
class MappingTree:
    """A map; keys are always texts."""

    entries: dict[str, Tree]
    line: int = 0


Tree = Scalar | SequenceTree | MappingTree


def resolve(text: str, quoted: bool = False) -> PlainValue:
    """
    Return a scalar's value as rcl reads it.

    Numbers out of the range of a double or int64 set ``errno`` in C, and rcl falls back to the
    next type: too large an integer becomes a double, ``1e400`` and ``1e-320`` become strings.
    """
    if quoted:
        return text
    if text in _BOOLS:
        return _BOOLS[text]
    if len(text) > 4000:  # longer than any number; keeps int() and float() fast
        return text
    integer = _integer(text)
    if integer is not None:
        return integer
    number = _double(text)
    return text if number is None else number


def _integer(text: str) -> int | None:
    match = _INTEGER.fullmatch(text)
    if match is None:
        return None
    sign, hexadecimal, octal, decimal = match.groups()
    size = int(hexadecimal, 16) if hexadecimal else int(octal, 8) if octal else int(decimal)
    value = -size if sign == '-' else size
    return value if -(2**63) <= value < 2**63 else None


def _double(text: str) -> float | None:
    if _SPECIAL.fullmatch(text):
        return float(text.replace('.', ''))
    word = _WORD.fullmatch(text)
    if word is not None:
        return float(word[1] + ('inf' if word[2] else 'nan'))
    if _DECIMAL.fullmatch(text):
        value = float(text)
        mantissa = re.split('[eE]', text)[0]
        zero = not re.search('[1-9]', mantissa)
        exact = False
    elif (match := _HEX_FLOAT.fullmatch(text)) is not None:
        try:
            value = float.fromhex(match[1] + (match[2] or ''))
        except OverflowError:
            return None
        digits = match[1].lower().partition('x')[2]
        zero = not re.search('[1-9a-f]', digits)
        exact = value != 0.0
    else:
        return None
    if value in (float('inf'), float('-inf')):
        return None
    tiny = abs(value) < sys.float_info.min
    return None if tiny and not zero and not exact else value


def parse(text: str) -> Tree | None:
    """
    Read one YAML document; ``None`` if it is empty.

    Raises ScenarioError (one line, with the line number) for invalid YAML, aliases, repeated
    keys, empty values, several documents and nesting deeper than ``MAX_DEPTH``.
    """
    try:
        return _Builder(text).build()
    except yaml.MarkedYAMLError as error:
        where = error.problem_mark or error.context_mark
        place = f'line {where.line + 1}: ' if where is not None else ''
        raise ScenarioError(
            f'{place}not valid YAML: {clip(str(error.problem or error.context))}'
        ) from None
    except yaml.YAMLError as error:
        raise ScenarioError(f'not valid YAML: {clip(str(error).splitlines()[0])}') from None
    except (UnicodeError, ValueError, OverflowError, IndexError, RecursionError) as error:
        if isinstance(error, ScenarioError):
            raise
        # PyYAML does not catch some of these for malformed escapes and version directives.
        raise ScenarioError(f'not valid YAML: {clip(str(error))}') from None


class _Builder:
    """Builds the tree from the parser's events, without recursion on hostile depth."""

    def __init__(self, text: str) -> None:
        self._events: Iterator[Any] = yaml.parse(text, Loader=_CParser)
        self._nodes = 0

    def build(self) -> Tree | None:
        root: Tree | None = None
        for event in self._events:
            if isinstance(event, yaml.DocumentStartEvent) and root is not None:
                raise ScenarioError(f'line {_line(event)}: only one YAML document is allowed')
            if isinstance(event, (yaml.NodeEvent, yaml.CollectionStartEvent)):
                if isinstance(event, yaml.ScalarEvent) and not event.value and _plain(event):
                    continue
                root = self._value(event, 1)
        return root

    def _value(self, event: Any, depth: int) -> Tree:
        if depth > MAX_DEPTH:
            raise ScenarioError(
                f'line {_line(event)}: nested too deeply (at most {MAX_DEPTH} levels)'
            )
        self._nodes += 1
        if self._nodes > MAX_NODES:
            raise ScenarioError(f'line {_line(event)}: more than {MAX_NODES} values')
        if isinstance(event, yaml.AliasEvent):
            raise ScenarioError(
                f'line {_line(event)}: alias *{clip(str(event.anchor))}: a ROS 2 parameter file '
                'allows no aliases; write the value out'
            )
        if isinstance(event, yaml.SequenceStartEvent):
            return self._sequence(event, depth)
        if isinstance(event, yaml.MappingStartEvent):
            return self._mapping(event, depth)
        return _scalar(event)

    def _sequence(self, start: Any, depth: int) -> SequenceTree:
        items: list[Tree] = []
        for event in self._events:
            if isinstance(event, yaml.SequenceEndEvent):
                break
            items.append(self._value(event, depth + 1))
        return SequenceTree(tuple(items), _line(start))

    def _mapping(self, start: Any, depth: int) -> MappingTree:
        entries: dict[str, Tree] = {}
        for event in self._events:
            if isinstance(event, yaml.MappingEndEvent):
                break
            if not isinstance(event, yaml.ScalarEvent) or not event.value:
                raise ScenarioError(f'line {_line(event)}: a key must be a text')
            if event.value in entries:
                raise ScenarioError(
                    f"line {_line(event)}: key '{clip(event.value)}' is given twice"
                )
            value = self._value(next(self._events), depth + 1)
            entries[event.value] = value
        return MappingTree(entries, _line(start))


def _plain(event: Any) -> bool:
    return event.style not in ("'", '"')


def _line(event: Any) -> int:
    return int(event.start_mark.line) + 1


def _scalar(event: Any) -> Scalar:
    if event.tag == 'tag:yaml.org,2002:str' and event.implicit != (True, False):
        return Scalar(event.value, event.value, _line(event))
    if _plain(event) and not event.value:
        raise ScenarioError(
            f'line {_line(event)}: no value after the key; give one or leave the key out'
        )
    return Scalar(resolve(event.value, not _plain(event)), event.value, _line(event))


def show(tree: Tree) -> str:
    """Return a value as text for an error message."""
    if isinstance(tree, Scalar):
        quoted = isinstance(tree.value, str)
        return f"'{clip(tree.text)}'" if quoted else clip(tree.text)
    if isinstance(tree, SequenceTree):
        return clip('[' + ', '.join(show(item) for item in tree.items[:6]) + ']')
    return 'a map'


def plain(tree: Tree) -> Any:
    """Return a tree as dicts, lists and values."""
    if isinstance(tree, Scalar):
        return tree.value
    if isinstance(tree, SequenceTree):
        return [plain(item) for item in tree.items]
    return {key: plain(value) for key, value in tree.entries.items()}


def tree_of(value: Any) -> Tree:
    """Return Python data as a tree, as if read from YAML; the inverse of ``plain``."""
    if hasattr(value, 'tolist'):  # numpy's arrays and scalars
        value = value.tolist()
    if isinstance(value, dict):
        return MappingTree({str(key): tree_of(item) for key, item in value.items()})
    if isinstance(value, (list, tuple)):
        return SequenceTree(tuple(tree_of(item) for item in value))
    if isinstance(value, (bool, int, float, str)):
        return Scalar(value, repr(value) if isinstance(value, float) else str(value))
    raise ScenarioError(f'{clip(repr(value))}: a value must be a number, a text or an array')


class _Dumper(yaml.SafeDumper):
    """Writes no anchors, which rcl does not support."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def float_text(value: float) -> str:
    """Return the shortest text that rcl, PyYAML and Python all read as exactly ``value``."""
    if (value != 0.0 and abs(value) < sys.float_info.min) or value - value != 0.0:
        raise ScenarioError(
            f'{value!r}: a number must be finite, and 0 or at least 2.3e-308 in size'
        )
    text = repr(float(value))
    mantissa, exponent, power = text.partition('e')
    return f'{mantissa if "." in mantissa else mantissa + ".0"}{exponent}{power}'


_Dumper.add_representer(
    float, lambda d, v: d.represent_scalar('tag:yaml.org,2002:float', float_text(v))
)
_Dumper.add_representer(
    str, lambda d, v: d.represent_scalar('tag:yaml.org,2002:str', v, style='"')
)
_Dumper.add_representer(
    list, lambda d, v: d.represent_sequence('tag:yaml.org,2002:seq', v, flow_style=True)
)


class _Key(str):
    """A map's key, written without quotes."""


_Dumper.add_representer(_Key, lambda d, v: d.represent_scalar('tag:yaml.org,2002:str', str(v)))


def write(data: dict[str, Any]) -> str:
    """Return nested maps as YAML text that rcl and PyYAML read alike."""
    return yaml.dump(
        _keys(data), Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=10**6,
        default_flow_style=False,
    )  # fmt: skip


def _keys(data: Any) -> Any:
    if isinstance(data, dict):
        return {_Key(key): _keys(value) for key, value in data.items()}
    return list(data) if isinstance(data, tuple) else data


def quoted(value: Any) -> str:
    """
    Return ``value`` (texts, numbers, lists, maps) on one line of ASCII, valid JSON and YAML.

    Only characters beyond U+FFFF are kept: YAML rejects JSON's surrogate pairs.
    """
    return ''.join(
        c if c < '\x7f' or c > '\uffff' else f'\\u{ord(c):04x}'
        for c in json.dumps(value, ensure_ascii=False)
    )
