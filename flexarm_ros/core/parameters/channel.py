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

"""Keys of a channel: the transport of samples, or of commands, from sender to receiver."""

from __future__ import annotations

from dataclasses import dataclass, fields, make_dataclass
from functools import cache
from typing import Any

from flexarm_ros.core.parameters.spec import parameter as _key

LONGEST_S = 0.999999999
"""Longest constant latency and longest jitter, s."""

LONGEST_MEASURED_S = 1000.0
"""Longest latency in a file, s."""


@dataclass(frozen=True)
class ChannelParameters:
    """The same keys in the section of each sensor and of the drives."""

    latency: float = _key(
        0.0, 'float', 's', 'age of a sample at delivery', low=0.0, high=LONGEST_S, whole_ns=True,
        live=True,
    )  # fmt: skip
    jitter: float = _key(
        0.0, 'float', 's', 'extra latency of each sample, drawn from jitter_distribution',
        low=0.0, high=LONGEST_S, live=True,
    )  # fmt: skip
    jitter_distribution: str = _key(
        'uniform', 'str', '', 'uniform: from 0 to jitter; exponential: mean jitter; normal: '
        'standard deviation jitter, the total latency cut at 0',
        choices=('uniform', 'exponential', 'normal'),
    )  # fmt: skip
    latency_file: str | None = _key(
        None, 'str', '', 'CSV of measured latencies, s, one a line, used in order and repeated, '
        'in place of latency and jitter; path relative to the scenario',
    )  # fmt: skip
    latencies: tuple[float, ...] | None = _key(
        None,
        'floats',
        's',
        'content of latency_file',
        low=0.0,
        high=LONGEST_MEASURED_S,
    )
    dropout: float = _key(
        0.0, 'float', '', 'probability that a sample is lost', low=0.0, high=1.0, live=True
    )
    dropout_burst: float = _key(
        1.0, 'float', '', 'mean number of samples lost in a row; 1: losses are independent; '
        'above: two-state Gilbert-Elliott channel', low=1.0, high=1e6,
    )  # fmt: skip
    arrival: str = _key(
        'newest', 'str', '', 'newest: a sample that arrives after a younger one is discarded; '
        'in_order: a queue, no sample overtakes another', choices=('newest', 'in_order'),
    )  # fmt: skip
    rate: float = _key(
        0.0, 'float', 'Hz', 'sample rate, an integer number of ticks per sample; 0: every tick',
        low=0.0, high=1e9,
    )  # fmt: skip

    @property
    def scheduled(self) -> bool:
        """Whether samples differ in their latency, or some are lost."""
        return self.jitter > 0.0 or self.dropout > 0.0 or self.latencies is not None


@cache
def with_channel(section: type) -> type:
    """Return the class of a section with the keys of a channel; its own keys take precedence."""
    if issubclass(section, ChannelParameters):
        return section
    made = make_dataclass(
        section.__name__, [], bases=(section, ChannelParameters), frozen=True,
        namespace={'__doc__': section.__doc__, '__reduce__': _reduce},
    )  # fmt: skip
    made.__module__, made.__qualname__ = section.__module__, section.__qualname__
    return made


def _reduce(held: Any) -> tuple[Any, ...]:
    """Return how ``held`` is restored, since its class is not an attribute of a module."""
    return _restored, (
        type(held).__mro__[1],
        {f.name: getattr(held, f.name) for f in fields(held)},
    )


def _restored(section: type, values: dict[str, Any]) -> Any:
    return with_channel(section)(**values)
