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

"""``flexarm stability`` as a user calls it."""

from __future__ import annotations

import json
import math
import re
from typing import Any

from flexarm_ros import scenario
import flexarm_ros.cli as cli
from flexarm_ros.stability.sampled_loop import SampledLoop
import pytest


def as_json(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, Any]:
    assert cli.main(['stability', *words, '--json']) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def test_the_table_gives_eigenvalues_margins_and_a_verdict_for_each_gain(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert cli.main(['stability', 'fls_tip', '--elbow', '0.9']) == 0
    printed = capsys.readouterr().out
    assert 'latency 1.238 ms' in printed
    verdicts = re.findall(r'^gain (\S+): (\w+)', printed, re.MULTILINE)
    assert verdicts == [('2.5', 'stable'), ('7.5', 'UNSTABLE'), ('12.5', 'UNSTABLE')]
    # The largest pair of the printed eigenvalues is the loop's own.
    first = re.search(r'eigenvalues at theta2 0.900: ([\d.]+)\+-([\d.]+)j', printed)
    assert first is not None
    loop = SampledLoop(scenario.load('fls_tip'), 0.9)
    assert math.hypot(float(first[1]), float(first[2])) == pytest.approx(loop.modulus(), abs=2e-6)


def test_json_has_the_paper_s_pd_stable_with_its_crossing_delay(
    capsys: pytest.CaptureFixture[str],
) -> None:
    found = as_json(capsys, 'pd_tip', '--elbow', '0.2838', '1.5908')
    assert (found['law'], found['location_m'], found['latency_s']) == ('pd', 9.0, 0.001238)
    assert found['stable'] is True
    stretched, bent = found['poses']
    # An outstretched arm bears least; both far less than the physical delay.
    assert found['crossing_delay_s'] == stretched['crossing_delay_s'] < bent['crossing_delay_s']
    assert 0.001238 < bent['crossing_delay_s'] < 0.0312
    assert stretched['delay_margin_s'] == pytest.approx(stretched['crossing_delay_s'] - 0.001238)
    assert stretched['gain_margin'] == pytest.approx(stretched['gain_range'][1])
    modulus = max(math.hypot(*value) for value in stretched['eigenvalues'])
    assert modulus == pytest.approx(stretched['modulus'])


def test_the_physical_delay_and_the_true_tip_are_told_unstable(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name in ('pd_tip_physical', 'pd_tip_elastic'):
        found = as_json(capsys, name, '--elbow', '0.9')
        assert found['stable'] is False
        assert found['modulus'] > 1.0
        assert found['poses'][0]['growth_rate_per_s'] > 1.0


def test_what_is_left_out_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    words = ['pd_tip_corrected', '--elbow', '0.9', '--set', 'controller.torque_limit=100']
    assert cli.main(['stability', *words]) == 0
    left_out = capsys.readouterr().out.splitlines()[-1]
    assert left_out == 'not in the analysis: controller.torque_limit, trajectory.delay'
    assert as_json(capsys, *words)['not_in_the_analysis'] == [
        'controller.torque_limit', 'trajectory.delay'
    ]  # fmt: skip


@pytest.mark.parametrize(
    ('words', 'told'),
    [
        (['open_loop'], 'controller.law: open_loop has no linear form'),
        (['nowhere'], 'nowhere: neither a file nor a shipped name'),
        (['pd_tip', '--elbow', 'nan'], "'nan' is not a finite number"),
        (['pd_tip', '--gain', '0'], '0: allowed are 1e-9 to 1e9'),
        (['pd_tip', '--max-latency', '2'], '2: allowed are over 0 to 1 s'),
        (['fls_tip', '--set', 'controller.ks=0'], 'controller.ks: 0.0, with no gain'),
        (['pd_tip', '--set', 'tip_sensor.latency=0.9'], 'tip_sensor.latency: 0.9 s is 900 ticks'),
    ],
)
def test_a_mistake_is_told_in_a_line(
    words: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        raise SystemExit(cli.main(['stability', *words]))
    captured = capsys.readouterr()
    assert ended.value.code == 2
    assert captured.out == ''
    assert told in captured.err
    assert len(captured.err.splitlines()) <= 2
