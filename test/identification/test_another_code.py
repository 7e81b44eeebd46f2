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
from typing import Any

import numpy as np
import pytest

fit_draws = pytest.importorskip('validation.fit_draws', reason='exudyn has wheels for x86_64 only')


SECONDS, DRAWS = 2.0, 20
"""Of ``make validate``: 4 s and 100."""


@cache
def flight() -> dict[str, np.ndarray]:
    motion: dict[str, np.ndarray] = fit_draws.exudyn_rig.fly(
        fit_draws.setting().config.plant, SECONDS
    )
    return motion


@cache
def links() -> Any:
    return searched(fit_draws.LINKS)


def searched(stage: Any, model: Any = None) -> Any:
    true = fit_draws.setting()
    return fit_draws.fitted(fit_draws.measured(flight(), true, 0), model or true, stage)


def test_the_places_of_the_gauges_are_those_of_the_rig() -> None:
    true = fit_draws.setting()
    places = fit_draws.exudyn_rig.gauge_places(true.config.plant)
    assert true.gauge.location == pytest.approx(places, rel=1e-6)


@pytest.mark.parametrize('stage', fit_draws.STAGES, ids=['links', 'joints'])
def test_numbers_are_found_within_their_uncertainty(stage: Any) -> None:
    """
    Few linear draws, and a search that ends where the linear step of its draw does.

    ``docs/validation.md`` has a hundred.  Where nine of ten errors are within two std, less
    than 16 of 20 are by chance once in a hundred times.
    """
    draws = fit_draws.linear_draws(flight(), stage, DRAWS)
    true, found = fit_draws.setting(), links() if stage is fit_draws.LINKS else searched(stage)
    assert set(draws) == set(found.parameters)
    for key, rows in draws.items():
        errors, stds = rows.T
        assert (np.abs(errors) < 2.0 * stds).sum() >= 16, key
        assert abs(errors.mean()) < 0.005, key
        row = found.parameters[key]
        assert row['value'] / true.number(key) - 1.0 == pytest.approx(errors[0], abs=0.5 * stds[0])
        assert row['std'] / true.number(key) == pytest.approx(stds[0], rel=0.2)


@pytest.mark.parametrize('name', list(fit_draws.models())[1:])
def test_wrong_models_show_in_the_residuals(name: str) -> None:
    """One mode of three, and a payload that is not the scenario's: far from what noise leaves."""
    right = fit_draws.strain_fits(links())
    wrong = fit_draws.strain_fits(searched(fit_draws.LINKS, fit_draws.models()[name]))
    assert min(right) > 97.0
    assert min(100.0 - x for x in wrong) > 2.0 * (100.0 - min(right))
