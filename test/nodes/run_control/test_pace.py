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

"""A scenario file that says how its run is paced: speed, steps, and a start that waits."""

from __future__ import annotations

from pathlib import Path
import signal
import subprocess
import sys

from flexarm_ros import scenario
from flexarm_ros.bag.checks.digest import digest_of
from flexarm_ros.scenario import ScenarioError
from flexarm_ros.scenario.sweeps.axes import Parameter
from nodetools import Asker, finish, flexarm_here, start_node, wait_for
import pytest
from repository import ROOT

FILE = """
/**:
  ros__parameters:
    duration: 0.1
    real_time_factor: 50
    use_sim_time: true
    qos_overrides: {/parameter_events: {publisher: {depth: 100}}}
plant:
  ros__parameters:
    step_ticks: 30
    start_paused: true
    start_type_description_service: true
    qos_overrides./clock.publisher.depth: 4
controller: {ros__parameters: {law: pd}}
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return a scenario with every such key."""
    path = tmp_path / 'paced.yaml'
    path.write_text(FILE)
    return path


def test_the_pace_is_read_and_is_no_part_of_the_numbers(file: Path, tmp_path: Path) -> None:
    config = scenario.load(file, ['start_paused=false', 'plant.real_time_factor=1e-3'])
    assert (config.pace.real_time_factor, config.pace.step_ticks) == (0.001, 30)
    assert config.pace.start_paused is False
    assert scenario.with_values(config, ['duration=0.2']).pace == config.pace
    plain = scenario.load('pd_tip', ['duration=0.1'])
    paced = scenario.load('pd_tip', ['duration=0.1', 'start_paused=true', 'real_time_factor=2'])
    assert scenario.dump(paced) == scenario.dump(plain)
    bags = []
    for number, more in enumerate(([], ['--set', 'start_paused=true'])):
        out = tmp_path / str(number)
        done = flexarm_here('simulate', 'pd_tip', '--set', 'duration=0.1', *more, '--no-pictures',
                            '--out', out)  # fmt: skip
        assert done.returncode == 0, done.stderr
        bags.append((out / 'bag' / 'bag_0.mcap').read_bytes())
    assert bags[0] == bags[1]


@pytest.mark.parametrize(
    ('override', 'complaint'),
    [
        ('step_tick=2', "did you mean '/\\*\\*.step_ticks'"),
        ('controller.step_ticks=2', "did you mean '/\\*\\*.step_ticks'"),
        ('plant.step_ticks=0', 'step_ticks: 0 is out of range'),
        ('start_paused=1', 'start_paused: 1 is not true or false'),
        ('real_time_factor=-1', 'real_time_factor: -1 is out of range'),
    ],
)
def test_a_bad_pace_is_named(override: str, complaint: str) -> None:
    with pytest.raises(ScenarioError, match=complaint):
        scenario.load('pd_tip', [override])


def test_the_pace_is_not_swept() -> None:
    with pytest.raises(ScenarioError, match='plant.step_ticks: cannot be swept'):
        Parameter.named('plant.step_ticks')


def test_a_switch_of_ros_is_true_or_false(tmp_path: Path) -> None:
    (tmp_path / 's.yaml').write_text('/**: {ros__parameters: {use_sim_time: 5}}\n')
    with pytest.raises(ScenarioError, match=r'/\*\*.use_sim_time: 5 is not allowed: true or'):
        scenario.load(tmp_path / 's.yaml')


def start(file: Path, out: Path, *words: str) -> subprocess.Popen[str]:
    """Start `flexarm run`."""
    return subprocess.Popen(
        [sys.executable, '-m', 'flexarm_ros.cli', 'run', str(file), '--no-pictures', '--out',
         str(out), *words],
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip


def paused_at(asker: Asker, tick: int) -> None:
    """Wait until the run rests there, at the speed that the file asks for."""
    said = f'paused at tick {tick}, 50 times real time'
    wait_for(lambda: asker.state() == said, 60, said)


@pytest.mark.nodes
@pytest.mark.parametrize('words', [[], ['--compose']], ids=['processes', 'compose'])
def test_a_run_begins_paused(
    words: list[str], file: Path, tmp_path: Path, ros_domain: int, rclpy_node
) -> None:
    from std_srvs.srv import Trigger

    out, sim = tmp_path / 'run', tmp_path / 'sim'
    run = start(file, out, *words)
    try:
        asker = Asker(*rclpy_node)
        paused_at(asker, 0)
        assert asker.call(Trigger, '/plant/step').message == '30 ticks'
        paused_at(asker, 30)
        asker.pause(False)
    finally:
        (text,) = finish([run])
    assert run.returncode == 0, text
    assert (
        f'begins paused; to begin: ROS_DOMAIN_ID={ros_domain} ros2 service call /plant/pause '
        "std_srvs/srv/SetBool '{data: false}'\n"
    ) in text
    assert flexarm_here('simulate', file, '--no-pictures', '--out', sim).returncode == 0
    assert digest_of(out) == digest_of(sim)
    assert flexarm_here('verify', out).returncode == 0


@pytest.mark.nodes
def test_a_run_that_nobody_attends_begins(file: Path, tmp_path: Path, ros_domain: int) -> None:
    from flexarm_ros.launcher.run import run_scenario, RunOptions

    config = scenario.load(file)
    outcome = run_scenario(config, 'paced', tmp_path / 'run', RunOptions(compose=True))
    assert outcome.stable, outcome.problem


@pytest.mark.nodes
def test_a_run_that_waits_to_begin_is_interrupted(
    file: Path, tmp_path: Path, ros_domain: int, rclpy_node
) -> None:
    run = start(file, tmp_path / 'run')
    try:
        paused_at(Asker(*rclpy_node), 0)
        run.send_signal(signal.SIGINT)
    finally:
        (text,) = finish([run])
    assert run.returncode == 130, text
    assert 'Traceback' not in text


@pytest.mark.nodes
def test_nodes_by_hand_wait_too(file: Path, tmp_path: Path, ros_domain: int, rclpy_node) -> None:
    from std_srvs.srv import SetBool, Trigger

    output = f'recorder:output:={tmp_path / "run"}'
    nodes = [start_node('compose', file, '-r', '__ns:=/left', '-p', output)]
    try:
        asker = Asker(*rclpy_node)

        def waits() -> bool:
            state = asker.call(Trigger, '/left/plant/state').message
            return bool(state.startswith('paused at tick 0'))

        wait_for(waits, 60, 'paused')
        assert asker.call(SetBool, '/left/plant/pause', data=False).success
    finally:
        texts = finish(nodes)
    assert nodes[0].returncode == 0, texts[0]
    assert 'to start: ros2 service call /left/plant/pause std_srvs/srv/SetBool' in texts[0]


@pytest.mark.nodes
@pytest.mark.parametrize(
    ('key', 'value'),
    [('real_time_factor', -1.0), ('real_time_factor', float('nan')), ('step_ticks', 0)],
)
def test_rclpy_refuses_a_pace_out_of_range(rclpy_node, key: str, value: float) -> None:
    """The plant takes what passes the declared range, and checks it no second time."""
    from flexarm_ros.nodes.runtime.parameters.declared import declare_own
    from flexarm_ros.nodes.runtime.parameters.own import OWN
    from rclpy.parameter import Parameter as RosParameter

    node, _ = rclpy_node
    declare_own(node, 'plant', OWN['plant'], [])
    (answer,) = node.set_parameters([RosParameter(key, value=value)])
    assert not answer.successful
    assert node.get_parameter(key).value == OWN['plant'][key].default
