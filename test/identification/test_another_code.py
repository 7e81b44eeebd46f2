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

"""Fits of an arm that another code computed: few noise draws; ``make validate`` has a hundred."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

fit_draws = pytest.importorskip('validation.fit_draws', reason='exudyn has wheels for x86_64 only')


@cache
def flight() -> dict[str, np.ndarray]:
    motion: dict[str, np.ndarray] = fit_draws.exudyn_rig.fly(
        fit_draws.setting().config.plant, fit_draws.SECONDS
    )
    return motion


def test_the_places_of_the_gauges_are_those_of_the_rig() -> None:
    true = fit_draws.setting()
    places = fit_draws.exudyn_rig.gauge_places(true.config.plant)
    assert true.gauge.location == pytest.approx(places, rel=1e-6)


def test_numbers_are_found_within_their_uncertainty() -> None:
    """One draw of links and joints; `validation.fit_draws` has a hundred."""
    true = fit_draws.setting()
    data = fit_draws.measured(flight(), true, 0)
    found = fit_draws.fitted(data, true), fit_draws.fitted_joints(data, true)
    rows = np.array(
        [
            (row['value'] / true.number(key) - 1.0, row['std'] / true.number(key))
            for one in found
            for key, row in one.parameters.items()
        ]
    )
    errors, stds = np.abs(rows).T
    assert len(rows) == 7 + 6
    assert (errors < 0.01).sum() >= 12
    assert (errors < 2.0 * stds).sum() >= 11
    assert (stds < 0.01).all()


def test_wrong_models_show_in_the_residuals() -> None:
    """One mode of three, and a payload that is not the scenario's: far from what noise leaves."""
    right, few, heavy = (
        [float(text) for text in row[1:]] for row in fit_draws.wrong_models(flight())
    )
    assert min(right) > 97.0
    for wrong in (few, heavy):
        assert min(100.0 - x for x in wrong) > 2.0 * (100.0 - min(right))
