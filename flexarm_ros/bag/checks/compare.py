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

"""Differences between two recorded runs, topic by topic and field by field."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
import math
import os
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.bag.errors import BagContentError
from flexarm_ros.bag.reading.reader import BagReader, open_run
from flexarm_ros.bag.tables.topics import batches
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.wire.cdr import FloatArray, IntArray
import numpy as np

STAMP = 'stamp_ns'


@dataclass
class FieldDifference:
    """
    The difference of one field of one topic between the two runs.

    ``largest`` and ``rms`` are of |A - B| (equal infinities and two NaN
    count as equal, NaN against a number as infinite), ``at_ns`` is the time since
    the start of the largest, ``first_ns`` that of the first beyond tolerance (None
    without one), ``beyond`` the number of those.
    """

    topic: str
    name: str
    count: int = 0
    largest: float = 0.0
    at_ns: int = 0
    beyond: int = 0
    first_ns: int | None = None
    square_sum: float = 0.0

    @property
    def rms(self) -> float:
        """Root mean square of the differences."""
        return math.sqrt(self.square_sum / self.count) if self.count else 0.0


@dataclass
class Comparison:
    """
    The result of a comparison.

    ``fields`` is in order of topics; ``only_a`` and ``only_b`` count messages of each topic
    at times that the other run does not have; ``parameters`` lists the differences of the
    scenarios, ``notes`` what could not be compared; ``damaged``: a bag is truncated or damaged.
    """

    fields: list[FieldDifference] = field(default_factory=list)
    only_a: dict[str, int] = field(default_factory=dict)
    only_b: dict[str, int] = field(default_factory=dict)
    parameters: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    damaged: bool = False

    @property
    def compared(self) -> int:
        """Number of compared values."""
        return sum(field.count for field in self.fields)

    @property
    def within(self) -> bool:
        """Whether all fields are within tolerance and every message has a counterpart."""
        return (
            self.compared > 0
            and not self.damaged
            and not (
                any(f.beyond for f in self.fields)
                or any(self.only_a.values())
                or any(self.only_b.values())
            )
        )


class _Side:
    """One run, read in step with the other, and its messages not yet compared."""

    def __init__(self, reader: BagReader) -> None:
        self.reader = reader
        self.names = {
            topic.path: (STAMP, *topic.codec.fields)
            for index, topic in enumerate(reader.topics)
            if index in reader.names
        }
        self._period = self.reader.timeline.period_ns
        self._source = batches(self.reader)
        self.rows: dict[str, tuple[IntArray, FloatArray]] = {}
        self.until = 0
        self.ended, self.empty = False, True

    def read(self) -> None:
        """Read the next batch and append it."""
        group = next(self._source, None)
        if group is None:
            self.ended, self.until = True, 1 << 62
            return
        for batch in group:
            path = self.reader.topics[batch.topic].path
            if path not in self.names:
                continue
            times = batch.ticks * self._period
            table = np.column_stack([batch.stamps.astype(float), batch.values])
            if path in self.rows:
                old_times, old = self.rows[path]
                times, table = np.concatenate([old_times, times]), np.concatenate([old, table])
            self.rows[path] = (times, table)
            if len(times):
                self.empty = False
                self.until = max(self.until, int(times[-1]) + 1)

    def take(self, path: str, until: int) -> tuple[IntArray, FloatArray]:
        """Remove and return the rows of a topic before time ``until``."""
        empty = (np.zeros(0, np.int64), np.zeros((0, len(self.names.get(path, ())))))
        times, table = self.rows.get(path, empty)
        cut = int(np.searchsorted(times, until))
        self.rows[path] = (times[cut:], table[cut:])
        return times[:cut], table[:cut]


def compare(
    run_a: str | os.PathLike[str],
    run_b: str | os.PathLike[str],
    absolute: float = 0.0,
    relative: float = 0.0,
    given: RunConfig | None = None,
    namespace: str | None = None,
) -> Comparison:
    """
    Compare the messages of two runs at equal times since the start.

    A field is beyond tolerance where |A - B| > absolute + relative |B|.
    Fields of the same name are compared, in topics that both have; stamps in ns.
    ``given`` is the scenario of runs that have none and ``namespace`` that of runs in
    another recorder's bag.  Raises BagError if a run cannot be read or has no message.
    """
    a, b = (_Side(open_run(run, given, namespace)) for run in (run_a, run_b))
    if given is not None and a.reader.own and b.reader.own:
        raise BagContentError(f'{a.reader.path}: both runs have a scenario; leave out --scenario')
    result = Comparison(parameters=list(_parameters(a.reader, b.reader)))
    result.notes += _external({'A': a.reader, 'B': b.reader})
    fields = _shared_fields(a, b, result)
    paths = list(fields)
    result.only_a, result.only_b = dict.fromkeys(paths, 0), dict.fromkeys(paths, 0)
    while not (a.ended and b.ended):
        for side in (a, b):
            if not side.ended and side.until <= min(a.until, b.until):
                side.read()
        until = min(a.until, b.until)
        for path in paths:
            times_a, table_a = a.take(path, until)
            times_b, table_b = b.take(path, until)
            both, in_a, in_b = np.intersect1d(times_a, times_b, return_indices=True)
            result.only_a[path] += len(times_a) - len(both)
            result.only_b[path] += len(times_b) - len(both)
            for difference, column_a, column_b in fields[path]:
                _accumulate(
                    difference, both, table_a[in_a, column_a], table_b[in_b, column_b],
                    absolute, relative,
                )  # fmt: skip
    for letter, side in (('A', a), ('B', b)):
        if side.empty:
            raise side.reader.nothing()
        if side.reader.damage is not None:
            result.damaged = True
            result.notes.append(str(side.reader.damage))
        result.notes += [f'{letter}: {text}' for text in (*side.reader.notes, *side.reader.gaps)]
    return result


def _shared_fields(
    a: _Side, b: _Side, result: Comparison
) -> dict[str, list[tuple[FieldDifference, int, int]]]:
    """Return per topic the fields that both runs have, with their columns."""
    found: dict[str, list[tuple[FieldDifference, int, int]]] = {}
    for path in dict.fromkeys((*a.names, *b.names)):
        if path not in a.names or path not in b.names:
            found[path] = []  # its messages count as without counterpart
            continue
        names_a, names_b = a.names[path], b.names[path]
        shared = [name for name in names_a if name in names_b]
        lonely = [name for name in (*names_a, *names_b) if name not in shared]
        if lonely:
            result.notes.append(f'{path}: only one run has {", ".join(lonely)}')
        found[path] = [
            (FieldDifference(path, name), names_a.index(name), names_b.index(name))
            for name in shared
        ]
        result.fields += [difference for difference, _, _ in found[path]]
    return found


def _accumulate(
    difference: FieldDifference,
    times: IntArray,
    a: FloatArray,
    b: FloatArray,
    absolute: float,
    relative: float,
) -> None:
    if not len(times):
        return
    with np.errstate(invalid='ignore', over='ignore'):
        apart = np.abs(a - b)
        same = (a == b) | (np.isnan(a) & np.isnan(b))
        apart = np.where(same, 0.0, np.where(np.isnan(apart), np.inf, apart))
        allowed = absolute + relative * np.abs(b)
        beyond = ~same & ~(apart <= allowed)
        difference.square_sum += float(np.sum(apart * apart))
    difference.count += len(times)
    place = int(np.argmax(apart))
    if apart[place] > difference.largest:
        difference.largest, difference.at_ns = float(apart[place]), int(times[place])
    count = int(np.count_nonzero(beyond))
    if count and difference.first_ns is None:
        difference.first_ns = int(times[int(np.argmax(beyond))])
    difference.beyond += count


def _external(readers: Mapping[str, BagReader]) -> Iterator[str]:
    """Yield a note on the external nodes of each run."""
    for name, reader in readers.items():
        if reader.provenance.external:
            yield f'external nodes in {name}: {", ".join(reader.provenance.external)}'


def _parameters(reader_a: BagReader, reader_b: BagReader) -> Iterator[str]:
    """Yield each parameter that differs between the scenarios; none if one is missing."""
    if not (reader_a.has_scenario and reader_b.has_scenario):
        return
    a, b = reader_a.config, reader_b.config
    external = {*reader_a.provenance.external, *reader_b.provenance.external}
    dict_a, dict_b = scenario.to_dict(a, external), scenario.to_dict(b, external)
    for section, keys in dict_a.items():
        for key, value in keys.items():
            other: Any = dict_b[section][key]
            if value != other:
                yield f'{section}.{key}: {value!r} and {other!r}'
    if a.torques != b.torques:
        yield 'controller.torque_file: other rows'
    if a.changes != b.changes:
        counts = f'{len(a.changes)} and {len(b.changes)} times'
        yield f'parameters changed during the run: {counts}, differently'
