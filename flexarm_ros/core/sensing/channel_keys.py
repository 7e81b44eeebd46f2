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

"""Checks of a channel's keys; imported by every command, so without compiled code."""

from __future__ import annotations

from flexarm_ros.core.parameters.channel import ChannelParameters
from flexarm_ros.core.timeline import named_ns, ticks_between


def repeats(parameters: ChannelParameters) -> bool:
    """Return whether the receiver may have the same sample at several ticks."""
    return parameters.rate > 0.0 or parameters.scheduled


def check_loss(name: str, parameters: ChannelParameters, model: str = 'buffer') -> None:
    """Raise ``ValueError`` for bursts of losses that cannot be, or jitter of another model."""
    lost, burst = parameters.dropout, parameters.dropout_burst
    if burst > 1.0 and lost > burst * (1.0 - lost):
        least = f'at least {lost / (1.0 - lost):g}' if lost < 1.0 else 'no other'
        raise ValueError(
            f'{name}.dropout_burst: {burst!r} at a dropout of {lost!r}, allowed: 1 or {least}'
        )
    if parameters.scheduled and model != 'buffer':
        raise ValueError(
            f'{name}.latency_model: {model}, allowed with jitter, dropout or latency_file: buffer'
        )


def check_channel(name: str, parameters: ChannelParameters, period_ns: int) -> None:
    """Raise ``ValueError``, which names the key, for keys that are invalid together."""
    named_ns(f'{name}.latency', parameters.latency)
    ticks_between(f'{name}.rate', parameters.rate, period_ns)
    check_loss(name, parameters, getattr(parameters, 'latency_model', 'buffer'))
    if parameters.latency_file is not None and parameters.latencies is None:
        raise ValueError(f'{name}.latency_file: its contents were not supplied')
