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

"""`flexarm run`: lock-step, the same bytes whatever the load, everything recorded."""

from __future__ import annotations

from collections import Counter
import csv
import json
from pathlib import Path

from flexarm_ros.launcher import run
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from nodetools import burners, flexarm_here
import pytest
from rosbags.highlevel import AnyReader

pytestmark = pytest.mark.nodes
SHORT = ('--set', 'duration=0.5')
TOPICS = {'/clock', '/plant/state', '/joint_states', '/tip_sensor/odometry', '/reference',
          '/joint_command'}  # fmt: skip


@pytest.fixture(scope='module')
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Fly the same scenario in four ways."""
    base = tmp_path_factory.mktemp('runs')
    ways = {'quiet': ['run'], 'loaded': ['run'], 'composed': ['run', '--compose'],
            'simulated': ['simulate']}  # fmt: skip
    for name, command in ways.items():
        busy = burners(2) if name == 'loaded' else []
        try:
            done = flexarm_here(*command, 'fls_tip', *SHORT, '--no-pictures', '--out', base / name)
        finally:
            for process in busy:
                process.kill()
                process.wait()
        assert done.returncode == 0, done.stderr
    return {name: base / name for name in ways}


@pytest.mark.essential
@pytest.mark.parametrize('other', ['loaded', 'composed', 'simulated'])
@pytest.mark.parametrize('file', ['bag/bag_0.mcap', 'bag/metadata.yaml', 'trajectory.csv'])
def test_every_way_of_flying_gives_the_same_bytes(
    runs: dict[str, Path], other: str, file: str
) -> None:
    assert (runs['quiet'] / file).read_bytes() == (runs[other] / file).read_bytes()


@pytest.mark.essential
def test_each_topic_has_exactly_one_message_a_tick(runs: dict[str, Path]) -> None:
    with AnyReader([runs['quiet'] / 'bag']) as reader:
        stamps = {topic: Counter() for topic in reader.topics}
        for connection, time_ns, _ in reader.messages():
            stamps[connection.topic][time_ns] += 1
    assert set(stamps) == TOPICS
    ticks = Counter({1_000_000_000 + k * 1_000_000: 1 for k in range(500)})
    for topic, counted in stamps.items():
        assert counted == ticks, topic


def test_mcap_reads_the_torque(runs: dict[str, Path]) -> None:
    with open(runs['quiet'] / 'bag' / 'bag_0.mcap', 'rb') as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        torques = [
            list(message.effort)
            for *_, message in reader.iter_decoded_messages(topics=['/joint_command'])
        ]
    with (runs['quiet'] / 'trajectory.csv').open() as file:
        rows = list(csv.DictReader(file))
    assert torques == [[float(row['tau1']), float(row['tau2'])] for row in rows]


@pytest.mark.essential
def test_the_summary_says_how_it_went(runs: dict[str, Path]) -> None:
    summary = json.loads((runs['quiet'] / 'summary.json').read_text())
    assert summary['stable'] is True
    assert summary['ticks'] == 500
    assert summary['rtf'] == pytest.approx(0.5 / summary['wall_s'])
    assert summary['scenario']['/**']['duration'] == 0.5
    assert {'rclpy', 'numpy', 'flexarm_ros'} <= set(summary['versions'])


@pytest.mark.essential
def test_an_unstable_run_stops_and_says_so(tmp_path: Path) -> None:
    out = tmp_path / 'run'
    done = flexarm_here('run', 'fls_tip_physical', '--no-pictures', '--out', out)
    simulated = flexarm_here(
        'simulate', 'fls_tip_physical', '--no-pictures', '--out', tmp_path / 'sim'
    )
    assert done.returncode == simulated.returncode == 1
    assert 'unstable at tick' in done.stderr
    assert json.loads((out / 'summary.json').read_text())['stable'] is False
    for file in ('bag/bag_0.mcap', 'trajectory.csv'):
        assert (out / file).read_bytes() == (tmp_path / 'sim' / file).read_bytes()


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['--set', 'plant.lenght=[1, 1]'], 'plant.lenght'),
        (['--set', 'plant.length=[-1.0, 4.5]'], 'plant.length'),
        (['--set', 'tip_sensor.latency=-0.001'], 'tip_sensor.latency'),
        (['--set', 'control_period=0.0000000015'], 'control_period'),
        (['--set', 'trajectory.side=13'], 'trajectory.side'),
        (['--set', 'controller.kp=.nan'], 'controller.kp'),
        (['--domain', '999'], '--domain'),
    ],
)
def test_a_bad_request_starts_and_writes_nothing(
    tmp_path: Path, words: list[str], said: str
) -> None:
    done = flexarm_here('run', 'fls_tip', *words, '--out', tmp_path / 'run')
    assert done.returncode == 2
    assert said in done.stderr
    assert len(done.stderr.splitlines()) <= 2
    assert 'Traceback' not in done.stderr
    assert not (tmp_path / 'run').exists()


def test_a_run_never_overwrites_another(runs: dict[str, Path]) -> None:
    before = (runs['quiet'] / 'bag' / 'bag_0.mcap').read_bytes()
    done = flexarm_here('run', 'fls_tip', *SHORT, '--out', runs['quiet'])
    assert done.returncode == 2
    assert 'not overwritten' in done.stderr
    assert (runs['quiet'] / 'bag' / 'bag_0.mcap').read_bytes() == before


def test_rtf_holds_the_run_to_the_wall_clock(tmp_path: Path) -> None:
    out = tmp_path / 'run'
    done = flexarm_here('run', 'pd_tip', *SHORT, '--rtf', '0.5', '--no-pictures', '--out', out)
    assert done.returncode == 0, done.stderr
    # The last tick is due 0.998 s after the first; only being early is a fault here.
    assert json.loads((out / 'summary.json').read_text())['wall_s'] > 0.99


def test_a_law_with_a_memory_gives_the_same_bytes_in_nodes(tmp_path: Path) -> None:
    """Plan, gains and estimate of law adaptive: the same in every process."""
    short = ('--set', 'duration=0.2')
    for name, command in {
        'nodes': ['run'],
        'one': ['run', '--compose'],
        'none': ['simulate'],
    }.items():
        done = flexarm_here(
            *command, 'adaptive_smooth', *short, '--no-pictures', '--out', tmp_path / name
        )
        assert done.returncode == 0, done.stderr
    for file in ('bag/bag_0.mcap', 'trajectory.csv'):
        first = (tmp_path / 'nodes' / file).read_bytes()
        assert first == (tmp_path / 'one' / file).read_bytes()
        assert first == (tmp_path / 'none' / file).read_bytes()


@pytest.mark.parametrize(
    ('period_ns', 'ticks'),
    [(100_000, 256), (1_000_000, 250), (10_000_000, 25), (1_000_000_000, 16)],
)
def test_a_killed_recorder_can_lose_a_quarter_of_a_second(period_ns: int, ticks: int) -> None:
    from flexarm_ros.nodes.plant import recorder_window

    assert recorder_window(period_ns) == ticks


@pytest.mark.parametrize(
    ('value', 'text'), [(0.5, '0.5'), (1e-5, '1.0e-05'), (2.5e-7, '2.5e-07'), (1e6, '1000000.0')]
)
def test_a_speed_is_a_number_for_rcl_too(value: float, text: str) -> None:
    assert run._yaml(value) == text
