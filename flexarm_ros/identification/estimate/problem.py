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

"""The least-squares problem of a fit: free parameters, their priors, and residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import NamedTuple

from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.identification.prediction.predict import predict, Prediction
from flexarm_ros.identification.recording import Recording
from flexarm_ros.identification.setting import Setting, spec_of
from flexarm_ros.scenario.errors import clip, ScenarioError
import numpy as np
from numpy.typing import NDArray
from scipy.stats.qmc import LatinHypercube

Span = tuple[float, float]
MOST_POINTS = 1 << 20


@dataclass(frozen=True)
class Prior:
    """A normal prior of one number."""

    value: float
    std: float


@dataclass(frozen=True)
class Free:
    """A free number: key, start, bounds (open at inf) and its prior."""

    key: str
    start: float
    low: float
    high: float
    prior: Prior | None = None

    @property
    def scale(self) -> float:
        """Return the size of a typical change, > 0."""
        if self.prior is not None:
            return self.prior.std
        return abs(self.start) if self.start != 0.0 else 1.0


def free_number(setting: Setting, key: str, prior: Prior | None) -> Free:
    """Return a free number of a scenario with the range of its key."""
    spec = spec_of(key)
    low = -math.inf if spec.low is None else spec.low
    high = math.inf if spec.high is None else spec.high
    start = setting.number(key) if prior is None or setting.number(key) else prior.value
    if spec.low_open:
        low = np.nextafter(low, math.inf)
    if prior is not None and not low <= prior.value <= high:
        raise ScenarioError(f'--prior {key}: {prior.value:g} is out of range: {spec.allowed}')
    return Free(key, min(max(start, low), high), low, high, prior)


@dataclass(frozen=True)
class Task:
    """A recording to fit, or of which some spans, s, are held out."""

    recording: Recording
    held_out: tuple[Span, ...] = ()

    def mask(self, rows: int, inside: bool) -> NDArray[np.bool_]:
        """Return which samples are held out (``inside``), or which are not."""
        times = self.recording.times[:rows]
        held = np.zeros(rows, dtype=bool)
        for first, last in self.held_out:
            held |= (times >= first) & (times < last)
        return held if inside else ~held


class Residual(NamedTuple):
    """
    Residual of a channel, in its unit.

    ``task``: number of its recording; ``used`` (n,): the samples of the recording that count;
    ``values``: their residuals.
    """

    channel: str
    task: int
    used: NDArray[np.bool_]
    values: FloatArray


@dataclass(frozen=True)
class Problem:
    """What is minimised: the weighted squares of the residuals and of the priors' deviations."""

    setting: Setting
    free: tuple[Free, ...]
    tasks: tuple[Task, ...]
    mode: str
    window: float | None
    zero: float | None
    chosen: tuple[str, ...] = ()
    """The channels that are fitted; empty: all."""

    @property
    def keys(self) -> tuple[str, ...]:
        """Return the keys of the free numbers."""
        return tuple(free.key for free in self.free)

    def setting_at(self, values: FloatArray) -> Setting:
        """Return the scenario with the free numbers set, (p,)."""
        numbers = dict(zip(self.keys, map(float, values), strict=True))
        return self.setting.with_numbers(numbers)

    def predictions(self, values: FloatArray) -> list[Prediction]:
        """Return the prediction of each task's recording."""
        setting = self.setting_at(values)
        return [
            predict(task.recording, setting, self.mode, self.window, self.zero)
            for task in self.tasks
        ]

    def residuals(self, values: FloatArray) -> list[Residual]:
        """Return the residuals of each channel that is fitted, recording after recording."""
        found = []
        predictions = self.predictions(values)
        for place, (task, prediction) in enumerate(zip(self.tasks, predictions, strict=True)):
            for name, channel in prediction.channels.items():
                if self.chosen and name not in self.chosen:
                    continue
                used = channel.valid & task.mask(len(channel.valid), inside=False)
                values_of = (channel.measured - channel.predicted)[used]
                if len(values_of):
                    finite = np.nan_to_num(values_of, nan=1e6, posinf=1e6)
                    found.append(Residual(name, place, used, finite))
        if not found:
            raise ScenarioError('nothing to fit: every sample is held out, or no channel is left')
        return found

    def prior_residuals(self, values: FloatArray) -> FloatArray:
        """Return the deviations from the priors, in std."""
        return np.array(
            [
                (value - free.prior.value) / free.prior.std
                for free, value in zip(self.free, values, strict=True)
                if free.prior is not None
            ]
        )

    def prior_std(self) -> FloatArray:
        """Return the std of each prior, (p,); inf without one."""
        return np.array([free.prior.std if free.prior else math.inf for free in self.free])


def steps_of(free: Sequence[Free], values: FloatArray) -> FloatArray:
    """Return the first step of the forward differences of each number, (p,)."""
    sizes = np.array([max(abs(v), f.scale) for v, f in zip(values, free, strict=True)])
    return np.asarray(1e-6 * sizes)


SPREAD = 3.0
"""Largest factor between a number and its first start, where it has no prior."""


def starting_points(free: Sequence[Free], count: int) -> FloatArray:
    """
    Return points from which to search, (count, p): the given start, then spread ones.

    A Latin hypercube, the same for the same numbers: within two std of a prior, otherwise within a
    factor `SPREAD` of the start, or, where that is 0, within the range of the key.
    """
    start = np.array([one.start for one in free])
    if count < 2:
        return start[None]
    parts = LatinHypercube(len(free), seed=0).random(count - 1)
    return np.vstack([start, *(np.array(list(map(_spread, free, row))) for row in parts)])


def _spread(free: Free, part: float) -> float:
    """Return a start of one number at a part, 0 to 1, of the interval of its starts."""
    if free.prior is not None:
        value = free.prior.value + 2.0 * free.prior.std * (2.0 * part - 1.0)
    elif free.start != 0.0:
        value = free.start * SPREAD ** (2.0 * part - 1.0)
    else:
        low, high = max(free.low, -free.scale), min(free.high, free.scale)
        value = low + part * (high - low)
    return float(min(max(value, free.low), free.high))


def parse_prior(text: str) -> tuple[str, Prior]:
    """Read ``KEY=VALUE+-STD``.  Raises ScenarioError."""
    key, equals, rest = text.partition('=')
    value, sign, std = rest.replace('±', '+-').partition('+-')
    try:
        prior = Prior(float(value), float(std))
    except ValueError:
        prior = Prior(math.nan, math.nan)
    if not equals or not sign or not math.isfinite(prior.value) or not 0 < prior.std < math.inf:
        raise ScenarioError(f'--prior {clip(text)}: give KEY=VALUE+-STD, with STD above 0')
    return key.strip(), prior
