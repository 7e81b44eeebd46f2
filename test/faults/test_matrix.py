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

"""Every node, every fault, early, in the middle and late: how such a run ends."""

from __future__ import annotations

from itertools import product
from pathlib import Path

from faulttools import check_end, check_spare, faulty_run, OWN, SIGNALS
from flexarm_ros.launcher.processes import NodeProcesses
from nodetools import ROLES
import pytest

pytestmark = pytest.mark.nodes

EARLY, MIDDLE, LATE = 3, 250, 495
CASES = list(product(ROLES, (*SIGNALS, *OWN), (EARLY, MIDDLE, LATE)))
QUICK = [
    ('plant', 'kill', EARLY), ('plant', 'raise', MIDDLE), ('encoder', 'pause', EARLY),
    ('encoder', 'exit', MIDDLE), ('tip_sensor', 'raise', LATE), ('trajectory', 'exit', EARLY),
    ('controller', 'kill', MIDDLE), ('controller', 'pause', LATE), ('recorder', 'kill', LATE),
    ('recorder', 'raise', EARLY), ('plant', 'restart', MIDDLE), ('recorder', 'restart', EARLY),
]  # fmt: skip
"""Every node, every fault and every time at least once."""


@pytest.mark.parametrize(
    ('role', 'fault', 'tick'),
    [*(pytest.param(*case, marks=pytest.mark.essential) for case in QUICK[:3]), *QUICK[3:]],
)
def test_a_fault_ends_the_run(
    role: str, fault: str, tick: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = faulty_run(monkeypatch, tmp_path / 'run', role, fault, tick)
    try:
        check_end(done, role, fault, tick)
    finally:
        if done.spare is not None:
            check_spare(done)


@pytest.mark.slow
@pytest.mark.parametrize(('role', 'fault', 'tick'), [c for c in CASES if c not in QUICK])
def test_every_other_fault_ends_the_run(
    role: str, fault: str, tick: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = faulty_run(monkeypatch, tmp_path / 'run', role, fault, tick)
    try:
        check_end(done, role, fault, tick)
    finally:
        if done.spare is not None:
            check_spare(done)


def test_who_blames_another_is_not_silent_himself(tmp_path: Path) -> None:
    """The controller lacks the plant's state, the plant itself says that the recorder stands."""
    with NodeProcesses({}, {}, tmp_path) as nodes:
        nodes.report.failures = [
            {'role': 'controller', 'blame': 'plant', 'text': 'tick 9: no message on plant/state'},
            {'role': 'encoder', 'blame': 'plant', 'text': 'tick 9: no message on plant/state'},
            {'role': 'plant', 'blame': 'recorder', 'text': 'tick 9: nothing recorded'},
        ]
        assert nodes.blame() == 'recorder: tick 9: nothing recorded'
        nodes.report.failures[2] |= {'blame': 'plant', 'text': 'told by the controller'}
        assert nodes.blame() == 'plant: tick 9: no message on plant/state'


def test_the_quick_cases_cover_each_node_fault_and_time() -> None:
    assert len(CASES) == 90
    for place, values in enumerate((ROLES, (*SIGNALS, *OWN), (EARLY, MIDDLE, LATE))):
        assert {case[place] for case in QUICK} == set(values)
