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

"""``fa.predict`` and ``fa.fit``: a recording of an arm against a scenario."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import os
from typing import Any, TypeAlias

from flexarm_ros.identification.estimate import fitting
from flexarm_ros.identification.prediction import predict as prediction
from flexarm_ros.identification.recording import read, read_columns, Recording
from flexarm_ros.identification.setting import load_setting

PathLike: TypeAlias = str | os.PathLike[str]
Data: TypeAlias = PathLike | Recording | Mapping[str, Any]


def predict(
    data: Data,
    scenario: PathLike,
    mode: str = 'driven',
    window: float | None = None,
    zero: float | None = None,
    overrides: Sequence[str] = (),
) -> prediction.Prediction:
    """
    Predict a recording of an arm by a scenario.

    Parameters
    ----------
    data
        A CSV file, a run or a bag; or columns by name with their unit, as in a CSV:
        ``{"t_s": ..., "theta1_deg": ..., "strain1_rad": ...}``.
    scenario
        A file or the name of a shipped scenario, with ``plant.model: full``.
    mode
        As ``flexarm predict --mode``.
    window
        Length of windows, s, each predicted from the state that the data before it give; None: the
        complete recording, from rest.
    zero
        Take the offsets of strain channels from the first ``zero`` s of the data.
    overrides
        Texts ``node.key=value``.

    Returns
    -------
    Prediction
        ``numbers`` has fit, vaf and rms of each channel; ``channels`` the samples in SI units.

    Raises
    ------
    ScenarioError
        If the data or the scenario do not fit the purpose; one line.

    """
    setting = load_setting(scenario, overrides)
    return prediction.predict(_recording(data), setting, mode, window, zero)


def fit(
    data: Data | Sequence[Data],
    scenario: PathLike,
    free: Sequence[str],
    mode: str = 'driven',
    window: float | None = 2.0,
    zero: float | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
    hold_out: Sequence[Data] = (),
    overrides: Sequence[str] = (),
    channels: Sequence[str] = (),
    starts: int = 1,
) -> fitting.Fit:
    """
    Estimate numbers of a scenario from recordings of an arm, by least squares.

    Parameters
    ----------
    data
        One recording or several, as for `predict`.
    scenario
        Where the search starts.
    free
        Keys to estimate: ``plant.flexural_rigidity``, of one link ``plant.flexural_rigidity.1``.
    mode, window, zero, overrides
        As for `predict`.
    priors
        Key -> (value, standard deviation) of what is known beforehand.
    hold_out
        Recordings, or spans ``"T0:T1"`` in s of every one, that are not fitted but checked.
    channels
        Names of the channels to fit; empty: every one of the mode.
    starts
        Points from which is searched, of which the best result is taken: the scenario's numbers,
        then others within two standard deviations of a prior or a factor of 3.

    Returns
    -------
    Fit
        ``parameters`` has value, std, start and status of each key; ``channels`` and ``held_out``
        have the fit of each channel; ``setting`` is the fitted scenario.

    Raises
    ------
    ScenarioError
        If the data or the request do not fit the purpose; one line.

    """
    several = [data] if isinstance(data, (str, os.PathLike, Recording, Mapping)) else list(data)
    texts = [f'{key}={value!r}+-{std!r}' for key, (value, std) in (priors or {}).items()]
    request = fitting.prepare(
        [_recording(one) for one in several], scenario, free, mode, window, zero, texts,
        [_held_out(one) for one in hold_out], overrides, channels,
        starts,
    )  # fmt: skip
    return fitting.fit(request)


def _held_out(one: Data) -> PathLike | Recording:
    is_span = isinstance(one, str) and fitting.span_of(one) is not None
    return str(one) if is_span else _recording(one)


def _recording(data: Data) -> Recording:
    if isinstance(data, Recording):
        return data
    return read_columns(data) if isinstance(data, Mapping) else read(data)
