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

"""Runs and bags as recordings of an arm: their numbers are found again."""

from __future__ import annotations

from pathlib import Path

import flexarm_ros.cli as cli
from flexarm_ros.identification.estimate.fitting import fit, prepare
from flexarm_ros.identification.prediction.predict import predict
from flexarm_ros.identification.recording import read
from flexarm_ros.identification.setting import load_setting, text_of
from mcap.reader import make_reader
import pytest
from repository import ROOT
from rosbag2tools import Received, write_mcap

MOTION = [
    'duration=3.0', 'plant.initial_position=[0.0, 1.0]', 'trajectory.kind=square',
    'trajectory.side=0.3', 'trajectory.side_time=1.0', 'controller.kp=20.0', 'controller.kd=6.0',
]  # fmt: skip


@pytest.fixture(scope='module')
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('arm') / 'arm.yaml'
    text = (ROOT / 'examples' / 'bench_arm.yaml').read_text()
    path.write_text(text[: text.index('strain_gauge:')])
    path.write_text(text_of(load_setting(path, MOTION)))
    return path


@pytest.fixture(scope='module')
def run(arm: Path) -> Path:
    out = arm.parent / 'run'
    cli.main(['simulate', str(arm), '--no-pictures', '--out', str(out)])
    return out


@pytest.fixture(scope='module')
def foreign(run: Path) -> Path:
    """Return the messages of the run as another recorder keeps them: without its scenario."""
    with next((run / 'bag').glob('*.mcap')).open('rb') as file:
        messages = [
            Received(channel.topic, schema.name, message.log_time, message.data)
            for schema, channel, message in make_reader(file).iter_messages()
            if schema is not None
        ]
    return write_mcap(run.parent / 'foreign' / 'foreign_0.mcap', messages)


@pytest.mark.parametrize('mode', ['driven', 'torque'])
def test_the_tip_of_a_run_is_predicted(arm: Path, run: Path, mode: str) -> None:
    found = predict(read(run), load_setting(arm), mode).channels
    for name in ('tip_x', 'tip_y'):
        assert found[name].rms < 2e-4


@pytest.mark.parametrize('source', ['run', 'bag', 'foreign'])
def test_the_numbers_of_a_run_are_found_again(
    arm: Path, run: Path, foreign: Path, source: str
) -> None:
    """Within 1 %: joint angles count as linear between samples, which costs some 0.3 %."""
    data = {'run': run, 'bag': run / 'bag', 'foreign': foreign}[source]
    recording = read(data)
    assert ('tip_x' in recording.channels) == (source != 'foreign')
    start = ['plant.flexural_rigidity=[4.6, 1.0]', 'plant.link_end_mass=1.4']
    keys = ['plant.flexural_rigidity', 'plant.link_end_mass']
    found = fit(prepare([data], arm, keys, window=None, overrides=start)).parameters
    for key, true in (
        ('plant.flexural_rigidity.1', 4.0), ('plant.flexural_rigidity.2', 1.2),
        ('plant.link_end_mass', 1.2),
    ):  # fmt: skip
        assert found[key]['value'] == pytest.approx(true, rel=1e-2)
        assert found[key]['status'] == 'identified'
