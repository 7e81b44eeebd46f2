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

"""The checker of a value: one for files, ROS parameters, bags and callers."""

from __future__ import annotations

import math
from typing import Any

from flexarm_ros.api.numbers import within
from flexarm_ros.core.parameters.changes import Change
from flexarm_ros.core.parameters.spec import check, Spec
from flexarm_ros.scenario import ScenarioError
from flexarm_ros.scenario.yaml.convert import convert
from flexarm_ros.scenario.yaml.rclyaml import tree_of
from flexarm_ros.wire.parameter_event import checked
import numpy as np
import pytest

MASS = Spec('float', 'kg', '', low=0.0, low_open=True, high=10.0)
COUNT = Spec('int', '', '', low=1)
TIME = Spec('float', 's', '', low=0.0, whole_ns=True)

REFUSED: list[tuple[Spec, Any, str]] = [
    (MASS, 0.0, 'x: 0.0 is out of range; it must be above 0 and at most 10 kg'),
    (MASS, 11, 'x: 11 is out of range; it must be above 0 and at most 10 kg'),
    (MASS, math.inf, 'x: inf is not a finite number (above 0 and at most 10 kg)'),
    (MASS, math.nan, 'x: nan is not a finite number (above 0 and at most 10 kg)'),
    (MASS, 1e-310, 'x: 1e-310 is too small a number; use 0'),
    (MASS, True, 'x: True is not a number (above 0 and at most 10 kg)'),
    (MASS, '1', "x: '1' is not a number (above 0 and at most 10 kg)"),
    (COUNT, 1.0, 'x: 1.0 is not an integer (at least 1)'),
    (COUNT, True, 'x: True is not an integer (at least 1)'),
    (COUNT, 0, 'x: 0 is out of range; it must be at least 1'),
    (TIME, 1e-10, 'x: 1e-10 s is not a whole number of nanoseconds (at most 9 decimals)'),
    (Spec('bool', '', ''), 1, 'x: 1 is not true or false'),
    (Spec('str', '', '', choices=('a', 'b')), 'c', "x: 'c' is not allowed; one of a, b"),
    (Spec('str', '', ''), 'a\n', "x: 'a\\n' is not a printable text of 1 to 4096 characters"),
]


@pytest.mark.parametrize(('spec', 'value', 'text'), REFUSED)
def test_what_is_not_allowed_is_refused_in_one_line(spec: Spec, value: Any, text: str) -> None:
    with pytest.raises(ValueError) as found:
        check('x', spec, value)
    assert str(found.value) == text


def test_an_integer_will_do_for_a_number() -> None:
    found = check('x', MASS, 3)
    assert isinstance(found, float)
    assert found == 3.0


@pytest.mark.parametrize('value', [-1.0, math.nan, 1e-10, 1e-310])
def test_every_edge_asks_the_one_checker(value: float) -> None:
    """A latency from a file, from a bag and from a caller."""
    with pytest.raises(ScenarioError, match='^x: '):
        convert('x', TIME, tree_of(value))
    with pytest.raises(ValueError, match='^encoder.latency: '):
        checked(Change(1, 'encoder', 'latency', value))
    with pytest.raises(ValueError, match='^x: .*allowed: a number, at least 0 s$'):
        within('x', np.float64(value), TIME)
