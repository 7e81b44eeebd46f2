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
"""The bag of a free-running run: proved node by node, with its timing."""

from __future__ import annotations

from dataclasses import replace
import json
from pathlib import Path

from bagtools import small_config
from flexarm_ros import scenario
from flexarm_ros.analysis.report.page import render
from flexarm_ros.analysis.report.runs import load_run, RunError
from flexarm_ros.bag.checks.verify import verify
from flexarm_ros.bag.errors import BagError
from flexarm_ros.bag.recording import finish_run
from flexarm_ros.bag.simulation import simulate
from flexarm_ros.bag.timing import FILE, read_timing
from flexarm_ros.cli import main
from flexarm_ros.core.parameters.rig import DisturbanceParameters
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.results.real_time import KEYS
from flexarm_ros.wire.topics import COMMAND, per_tick_topics
from freetools import free_config, write_free
import numpy as np
import pytest

CONFIG = free_config(small_config(duration=0.1))


def now_and_then(k: int) -> int | None:
    """Return by how many ticks a command is late: most are not, some never arrive."""
    return {0: 0, 1: 4, 2: None}.get(k % 10, 0) if k > 3 else 2


@pytest.fixture(scope='module')
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the directory of a run with late and lost commands."""
    directory = tmp_path_factory.mktemp('free')
    write_free(directory / 'bag', CONFIG, now_and_then)
    finish_run(directory, CONFIG, 'free')
    return directory


def test_every_node_is_proved_by_what_it_had(run: Path) -> None:
    verdict = verify(run)
    assert verdict.same, verdict.earliest
    assert verdict.ticks == 100
    # Not the first two: no command had come.
    assert verdict.compared['controller'] == 100
    assert 'closed loop' not in verdict.compared
    assert not any('missing' in note for note in verdict.notes)


@pytest.mark.parametrize('byte', [-1, 4], ids=['torque', 'stamp'])
def test_a_command_that_was_not_computed_is_found(byte: int, tmp_path: Path) -> None:
    def alter(k: int, topic: int, data: bytes) -> bytes:
        if k != 52 or topic != COMMAND:
            return data
        changed = bytearray(data)
        changed[byte] ^= 1
        return bytes(changed)

    verdict = verify(write_free(tmp_path / 'bag', CONFIG, now_and_then, alter))
    assert not verdict.same
    assert verdict.first['controller'].tick == 52


def test_the_plant_is_proved_by_the_command_that_it_held(tmp_path: Path) -> None:
    """As if the plant had not held the last command, where none came in time."""
    lock = free_config(small_config(duration=0.1))
    late = write_free(tmp_path / 'late', lock, now_and_then)
    prompt = write_free(tmp_path / 'prompt', lock, lambda k: 0)
    assert verify(late).same and verify(prompt).same
    assert main(['digest', str(late)]) == main(['digest', str(prompt)]) == 0
    mixed = write_free(
        tmp_path / 'mixed', lock, now_and_then,
        lambda k, topic, data: data if topic != COMMAND or k != 30 else _of(prompt, k, topic),
    )  # fmt: skip
    assert 'plant' in verify(mixed).first


@pytest.fixture(scope='module')
def rig() -> RunConfig:
    """Return the lab arm, pushed all the time, as a free-running run of 100 ticks."""
    push = DisturbanceParameters(
        force_times=(0.0, 0.1), force_x=(0.0, 2.0), force_y=(1.0, 1.0), payload_times=(0.03, 0.06),
        payload_masses=(0.6, 0.1),
    )  # fmt: skip
    lab = scenario.load('lab_arm', ['duration=0.1'])
    further = sorted([*lab.further, ('disturbance', push)])
    return free_config(replace(lab, further=tuple(further)))


def test_drives_and_disturbances_are_proved_by_what_the_plant_held(
    rig: RunConfig, tmp_path: Path
) -> None:
    directory = tmp_path / 'run'
    verdict = verify(write_free(directory / 'bag', rig, now_and_then))
    assert verdict.same, verdict.earliest
    assert not any('missing' in note for note in verdict.notes)
    named = ('controller', 'actuator', 'disturbance')
    assert [verdict.compared[name] for name in named] == [100, 100, 200]
    finish_run(directory, rig, 'free')
    timing = read_timing(directory)
    assert timing is not None
    # It counts what the drives send, the answer to the states that the controller answered.
    np.testing.assert_array_equal(timing.answers[:4], [-1, -1, 0, 1])
    assert timing.summary()['missed_commands'] > timing.summary()['held_commands'] > 0


@pytest.mark.parametrize(
    ('name', 'byte'),
    [
        ('actuator/torque', -9),
        ('actuator/torque', 4),
        ('disturbance/wrench', -41),
        ('disturbance/wrench', 4),
        ('disturbance/payload', -73),
        ('disturbance/payload', 4),
    ],
    ids=[
        *('torque', 'stamp of the torque', 'force', 'stamp of the force', 'payload'),
        'stamp of the payload',
    ],
)
def test_what_was_not_computed_is_found_on_every_topic_that_the_plant_reads(
    name: str, byte: int, rig: RunConfig, tmp_path: Path
) -> None:
    place = [topic.name for topic in per_tick_topics(rig)].index(name)

    def alter(k: int, topic: int, data: bytes) -> bytes:
        if k != 52 or topic != place:
            return data
        changed = bytearray(data)
        changed[byte] ^= 1
        return bytes(changed)

    verdict = verify(write_free(tmp_path / 'bag', rig, now_and_then, alter))
    assert verdict.first[name.partition('/')[0]].tick == 52


def _of(bag: Path, tick: int, topic: int) -> bytes:
    from flexarm_ros.bag.reading.reader import BagReader

    found = dict(BagReader(bag).ticks())[tick][topic]
    assert found is not None
    return found


def test_the_summary_has_the_timing(run: Path) -> None:
    found = json.loads((run / 'summary.json').read_text())['real_time']
    assert tuple(found) == KEYS
    assert found['factor'] == pytest.approx(1.0)
    assert found['late_ticks'] == 0
    # Of ten commands one is late by four ticks, when a newer one is there, and one is lost.
    assert found['missed_commands'] >= found['held_commands'] >= 18
    assert found['tick_jitter_ms']['p99'] == pytest.approx(0.1)
    assert found['command_latency_ms']['p50'] == pytest.approx(0.2)


def test_the_timing_is_kept_beside_the_bag(run: Path) -> None:
    timing = read_timing(run)
    assert timing is not None and len(timing.begin) == 100
    found = json.loads((run / 'summary.json').read_text())['real_time']
    assert timing.summary() == found
    assert read_timing(run / 'bag') is None
    np.testing.assert_array_equal(timing.answers[:2], -1)


def test_the_report_shows_it(run: Path, tmp_path: Path) -> None:
    page = render([load_run(run)])
    assert '<h2 id="h-timing">Timing</h2>' in page
    assert page.count('<svg viewBox') == 2
    assert 'Command latency: ' in page and 'Missed commands' in page
    simulate(small_config(duration=0.05), tmp_path / 'lockstep')
    assert 'h-timing' not in render([load_run(tmp_path / 'lockstep')])


@pytest.mark.parametrize('text', ['', 't,begin\n1,2\n', 't,begin,due,answers,arrival\n1,x\n'])
def test_a_file_that_is_no_timing_is_named(text: str, run: Path, tmp_path: Path) -> None:
    (tmp_path / FILE).write_text(text)
    with pytest.raises(BagError, match='timing.csv'):
        read_timing(tmp_path)
    for name in ('trajectory.csv', 'summary.json'):
        (tmp_path / name).write_bytes((run / name).read_bytes())
    with pytest.raises(RunError, match='timing.csv'):
        render([load_run(tmp_path)])


def test_a_simulation_has_no_wall_clock_to_run_by(tmp_path: Path) -> None:
    summary = simulate(CONFIG, tmp_path / 'run', 'free')
    assert summary['stable'] and 'real_time' not in summary
    assert summary['scenario']['/**']['sync'] == 'lockstep'
    assert verify(tmp_path / 'run').same
