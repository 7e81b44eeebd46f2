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

"""Laws from outside this package: installed ones, ``package.module:Class``, and what bags name."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
import json
from pathlib import Path
import shutil
import sys
import threading
from typing import Any, NamedTuple

import flexarm_ros as fa
from flexarm_ros import cli, scenario
from flexarm_ros.core.control import Law, Sample
from flexarm_ros.core.parameters.changes import Change
from flexarm_ros.core.parameters.sections import changed, OWN_LAWS, RunConfig
from flexarm_ros.core.parameters.spec import parameter
from flexarm_ros.scenario.plugins import registry as plugins
from nodetools import Asker, flexarm, wait_for
import pytest
from repository import ROOT
from strangertools import fly_suite, fly_sweep

MOVING = (
    '--set', 'trajectory.kind=hold', '--set', 'plant.initial_velocity=[0.1, -0.2]',
    '--set', 'duration=0.2',
)  # fmt: skip
FLOWN = (
    'pd_collocated', '--set', 'controller.law=joint_pd', '--set',
    'controller.joint_pd.stiffness=900', *MOVING,
)  # fmt: skip
MODULE = """
from pathlib import Path
from flexarm_ros.core.control import Law
Path({mark!r}).touch()

class Braking(Law):
    def torque(self, k, sample):
        return -50.0 * sample.encoder[2], -50.0 * sample.encoder[3]
"""


class Named(NamedTuple):
    """A run whose bag names a module, and what its import leaves."""

    run: Path
    mark: Path


@pytest.fixture
def named(registry: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Named:
    """Fly a law of a module as a user does, then forget that it was imported."""
    mark = tmp_path / 'imported'
    (tmp_path / 'site').mkdir()
    (tmp_path / 'site' / 'somebodys_law.py').write_text(MODULE.format(mark=str(mark)))
    monkeypatch.syspath_prepend(tmp_path / 'site')
    monkeypatch.setenv('PYTHONPATH', f'{tmp_path / "site"}:{ROOT}')
    words = ('--set', 'controller.law=somebodys_law:Braking', *MOVING, '--no-pictures')
    flown = flexarm('simulate', 'pd_collocated', *words, '--out', tmp_path / 'run')
    assert flown.returncode == 0, flown.stderr
    assert mark.exists()
    mark.unlink()
    return Named(tmp_path / 'run', mark)


def test_an_installed_law_is_found_by_its_name(
    stranger: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(['list', '--list-laws']) == 0
    assert 'joint_pd   stranger-arm (stranger_arm.laws:JointPd)' in capsys.readouterr().out
    assert cli.main(['simulate', '--list-laws']) == 0
    assert 'joint_pd' in capsys.readouterr().out.splitlines()
    out = tmp_path / 'run'
    assert cli.main(['simulate', *FLOWN, '--no-pictures', '--out', str(out)]) == 0
    summary = json.loads((out / 'summary.json').read_text())
    assert summary['scenario']['controller']['joint_pd.stiffness'] == 900.0
    assert summary['scenario']['controller']['joint_pd.damping'] == 300.0
    assert summary['max_torque'] > 10.0
    capsys.readouterr()
    assert cli.main(['verify', str(out)]) == 0
    assert 'closed loop  1200 messages the same' in capsys.readouterr().out
    assert cli.main(['report', str(out), '--out', str(tmp_path / 'page')]) == 0
    assert cli.main(['export', str(out), '--out', str(tmp_path / 'rows')]) == 0
    assert cli.main(['compare', str(out), str(out)]) == 0
    assert cli.main(['stability', *FLOWN]) == 0
    assert 'gain 1: stable' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('setting', 'text'),
    [
        ('joint_pd.stiffness=-1', 'joint_pd.stiffness: -1 is out of range; it must be at least 0'),
        ('joint_pd.stifness=1', "unknown key; did you mean 'controller.joint_pd.stiffness'?"),
        ('law=joint_p', "'joint_p' is not allowed; one of pd, fls"),
        ('law=no_such:Law', 'cannot be imported: ModuleNotFoundError'),
        ('law=stranger_arm.laws:Gains', 'not a subclass of flexarm_ros.core.control.Law'),
        ('law=a b:c', 'give package.module:Class'),
    ],
)
def test_a_bad_law_or_key_is_named(
    stranger: Path, setting: str, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ['simulate', 'pd_collocated', '--set', f'controller.{setting}', '--out', '/nowhere/x']
    assert cli.main(words) == 2
    error = capsys.readouterr().err
    assert text in error
    assert len(error.splitlines()) == 1


def test_a_scenario_with_an_own_law_is_read_back_and_a_shipped_one_is_as_it_was(
    stranger: Path,
) -> None:
    before = scenario.dump(scenario.load('pd_tip'))
    config = scenario.load('pd_tip', ['controller.joint_pd.damping=7', 'controller.law=joint_pd'])
    assert config.controller.own().damping == 7.0
    assert scenario.from_text(scenario.dump(config)) == config
    assert scenario.from_dict(scenario.to_dict(config)) == config
    assert scenario.with_values(config, ['controller.law=pd']).controller.own('joint_pd') == (
        config.controller.own()
    )
    tuned = changed(config, Change(3, 'controller', 'joint_pd.damping', 8.0))
    assert tuned.controller.own().damping == 8.0
    assert scenario.dump(scenario.load('pd_tip')) == before


def test_a_live_gain_is_taken_by_the_law(stranger: Path) -> None:
    from flexarm_ros.core.run.loop import ClosedLoop

    config = scenario.load('pd_collocated', [word for word in FLOWN[1:] if word != '--set'])
    change = Change(1, 'controller', 'joint_pd.damping', 0.0)
    loop = ClosedLoop(replace(config, changes=(change,)))
    loop.tick()
    assert loop.law.parameters.damping == 300.0
    loop.tick()
    assert loop.law.parameters.damping == 0.0


def test_suite_and_sweep_fly_an_installed_law(stranger: Path, tmp_path: Path) -> None:
    base = tmp_path / 'own.yaml'
    base.write_text(
        'controller:\n  ros__parameters:\n    joint_pd: {stiffness: 900.0}\n    law: joint_pd\n'
        'trajectory:\n  ros__parameters: {kind: hold}\n'
        '/**:\n  ros__parameters: {duration: 0.1}\n'
        'plant:\n  ros__parameters: {initial_velocity: [0.1, -0.2]}\n'
    )
    fly_suite(base, tmp_path / 'suite')
    grid = '  controller.law: [pd, joint_pd]\n  controller.joint_pd.damping: [100.0, 300.0]\n'
    fly_sweep(base, grid, tmp_path / 'sweep')
    text = next((tmp_path / 'sweep').rglob('*.csv')).read_text()
    assert text.count('stable') >= 4


def test_a_class_flies_under_its_own_name(registry: None, tmp_path: Path) -> None:
    @dataclass(frozen=True)
    class Gains:
        damping: float = parameter(40.0, 'float', 'N m s/rad', 'damping', low=0.0, high=1e6)

    class Braking(Law):
        Parameters = Gains

        def torque(self, k: int, sample: Sample) -> tuple[float, float]:
            damping = self.parameters.damping
            return -damping * sample.encoder[2], -damping * sample.encoder[3]

    start = {'trajectory': {'kind': 'hold'}, 'plant': {'initial_velocity': (0.1, -0.2)}}
    run = fa.simulate('pd_collocated', law=Braking, duration=0.05, out=tmp_path / 'run', **start)
    assert run.summary['scenario']['controller']['law'] == 'Braking'
    more = fa.simulate(
        'pd_collocated', law=Braking, controller={'Braking': {'damping': 80.0}}, duration=0.05,
        **start,
    )  # fmt: skip
    assert more.trajectory['tau1'][0] == 2.0 * run.trajectory['tau1'][0] == -8.0
    with pytest.raises(fa.ScenarioError, match='Braking.damping: -1'):
        fa.configure('pd_tip', law=Braking, controller={'Braking': {'damping': -1}})


def _declared(**entries: Any) -> type:
    return type('Odd', (Law,), {'torque': lambda *_: (0.0, 0.0), **entries})


@dataclass(frozen=True)
class _Bare:
    gain: float = 1.0


@dataclass(frozen=True)
class _OutOfRange:
    gain: float = parameter(-1.0, 'float', '', 'a gain', low=0.0)


@dataclass(frozen=True)
class _LiveInteger:
    count: int = parameter(1, 'int', '', 'a number', live=True)


@pytest.mark.parametrize(
    ('law', 'text'),
    [
        (dict, 'not a subclass'),
        (_declared(NAME='pd'), "pd is a name of this package's"),
        (_declared(NAME='lqg'), "lqg is a name of this package's"),
        (_declared(NAME='plan'), "plan is a name of this package's"),
        (_declared(NAME='a.b'), 'is not a name of letters'),
        (_declared(Parameters=dict), 'not a frozen dataclass'),
        (_declared(Parameters=_Bare), r'gain is not made by parameter\(\)'),
        (_declared(Parameters=_OutOfRange), 'default: -1.0 is out of range'),
        (_declared(Parameters=_LiveInteger), 'only a float may be live'),
    ],
)
def test_a_class_that_is_no_law_is_refused(registry: None, law: Any, text: str) -> None:
    before = set(OWN_LAWS)
    with pytest.raises(fa.ScenarioError, match=text):
        fa.configure('pd_tip', law=law)
    assert set(OWN_LAWS) == before


AGAIN = 'the same run again'
READING: dict[str, tuple[str, ...]] = {
    'verify': (), 'digest': (), 'report': ('--out', 'page'), 'export': ('--out', 'rows'),
    'recover': ('--out', 'rescued'), 'compare': (AGAIN,), 'view': ('--port', '0'), 'replay': (),
    'predict': ('--scenario', 'fls_full'),
    'fit': ('--scenario', 'fls_full', '--free', 'plant.flexural_rigidity', '--out', 'fitted'),
}  # fmt: skip
"""Command that reads a bag -> the words after the bag."""


def test_the_commands_that_read_a_bag_are_known() -> None:
    found = set()
    for command in cli.COMMANDS:
        (commands,) = (
            action
            for action in cli.build_parser([command])._actions
            if isinstance(action, argparse._SubParsersAction)
        )
        places = commands.choices[command]._get_positional_actions()
        if any('bag' in (place.help or '') for place in places):
            found.add(command)
    assert found == set(READING)


@pytest.mark.parametrize('command', sorted(set(READING) - {'replay'}))  # replay: see below
def test_a_bag_never_makes_a_command_import_what_it_names(
    named: Named, tmp_path: Path, command: str, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    from flexarm_ros.identification.estimate import fitting
    from flexarm_ros.identification.prediction import predict
    from flexarm_ros.nodes.view import page

    def stop(*_: Any) -> Any:
        raise fa.ScenarioError('the bag has been read')

    # What these do with the recording takes long, and none of it looks at the bag.
    stopped = {'fit': (fitting, 'fit'), 'predict': (predict, 'predict'),
               'view': (page, 'PageServer')}  # fmt: skip
    if command in stopped:
        monkeypatch.setattr(*stopped[command], stop)
    monkeypatch.chdir(tmp_path)
    bare = shutil.copytree(named.run / 'bag', tmp_path / 'bare')  # without the files beside it
    for run in (named.run, bare):
        words = [str(run) if word == AGAIN else word for word in READING[command]]
        status = cli.main([command, str(run), *words])
        output = capsys.readouterr()
        assert status == (2 if command in stopped else 0), output.err
        assert ('the bag has been read' in output.err) is (command in stopped)
        for word in words:
            if (tmp_path / word).is_dir() and word != str(run):
                shutil.rmtree(tmp_path / word)
    assert not named.mark.exists()
    assert 'somebodys_law' not in sys.modules


def test_verify_takes_a_law_that_the_user_trusts(named: Named) -> None:
    verified = flexarm('verify', named.run)
    assert verified.returncode == 0, verified.stderr + verified.stdout
    assert 'closed loop not computed: controller unknown here' in verified.stdout
    assert '--trust somebodys_law' in verified.stdout
    assert 'encoder      200 messages the same' in verified.stdout
    assert not named.mark.exists()
    trusted = flexarm('verify', named.run, '--trust', 'somebodys_law')
    assert trusted.returncode == 0, trusted.stderr
    assert 'closed loop  1200 messages the same' in trusted.stdout
    assert named.mark.exists()
    refused = flexarm('verify', named.run, '--trust', 'some/path.py')
    assert refused.returncode == 2
    assert "'some/path.py' is not a PACKAGE.MODULE" in refused.stderr


def test_data_and_texts_import_nothing(named: Named) -> None:
    told = {'controller': {'law': 'somebodys_law:Braking'}}
    with pytest.raises(fa.ScenarioError, match='is not allowed'):
        scenario.from_dict(told)
    text = 'controller:\n  ros__parameters: {law: somebodys_law:Braking}\n'
    with pytest.raises(fa.ScenarioError, match='is not allowed'):
        scenario.from_text(text)
    assert not named.mark.exists()
    plugins.trust(['somebodys'])  # another module
    with pytest.raises(fa.ScenarioError, match='is not allowed'):
        scenario.from_text(text)
    plugins.trust(['somebodys_law'])
    assert scenario.from_text(text).controller.law == 'somebodys_law:Braking'
    assert named.mark.exists()


def test_a_bag_may_name_a_law_of_this_package(registry: None) -> None:
    law = 'flexarm_ros.core.control.state_feedback:StateFeedback'
    text = f'controller:\n  ros__parameters: {{law: "{law}"}}\n'
    assert scenario.from_text(text).controller.law == law
    elsewhere = text.replace('control.state_feedback', 'run.metrics')
    with pytest.raises(fa.ScenarioError, match='is not allowed'):
        scenario.from_text(elsewhere)


@pytest.mark.nodes
def test_a_peer_names_no_module_to_import(named: Named) -> None:
    from flexarm_ros.nodes.runtime.joining.config_exchange import (
        Disagreement,
        dump_sections,
        merge_sections,
        published_config,
    )

    told = json.loads(dump_sections(RunConfig(), 'controller'))
    told['controller']['law'] = 'somebodys_law:Braking'
    peers = {'controller': ('controller', json.dumps(told))}
    with pytest.raises(Disagreement):
        merge_sections(RunConfig(), peers)
    peers['plant'] = ('plant', dump_sections(RunConfig(), 'plant'))
    assert published_config(RunConfig(), peers).controller.law == 'pd'
    assert not named.mark.exists()


@pytest.mark.nodes
def test_replay_imports_nothing_that_a_bag_names(named: Named, ros_domain: int) -> None:
    words = ('replay', named.run, '--rate', '0', '--delay', '0', '--domain', str(ros_domain))
    played = flexarm(*words)
    assert played.returncode == 0, played.stderr
    assert not named.mark.exists()


@pytest.mark.nodes
def test_nodes_fly_an_installed_law_with_the_bytes_of_simulate(
    stranger: Path, tmp_path: Path, ros_domain: int
) -> None:
    words = (*FLOWN, '--no-pictures')
    assert flexarm('simulate', *words, '--out', tmp_path / 'simulate').returncode == 0
    digests = [flexarm('digest', tmp_path / 'simulate').stdout.split()[0]]
    for name, more in (('run', ()), ('composed', ('--compose',))):
        done = flexarm('run', *words, *more, '--out', tmp_path / name)
        assert done.returncode == 0, done.stderr
        digests.append(flexarm('digest', tmp_path / name).stdout.split()[0])
    assert len(set(digests)) == 1


@pytest.mark.nodes
def test_an_own_parameter_is_described_and_set_while_the_run_goes_on(
    stranger: Path, tmp_path: Path, ros_domain: int, rclpy_node: Any
) -> None:
    from flexarm_ros.bag.reading.reader import BagReader
    from rcl_interfaces.srv import DescribeParameters

    ask = Asker(*rclpy_node)
    out, done = tmp_path / 'run', []
    words = ('run', *FLOWN, '--set', 'duration=1.0', '--rtf', '0.05', '--no-pictures',
             '--out', out)  # fmt: skip
    run = threading.Thread(target=lambda: done.append(flexarm(*words)))
    run.start()
    key = 'joint_pd.damping'
    try:
        wait_for(lambda: ask.tick() > 20, 60, 'the run has begun')
        told = ask.call(DescribeParameters, '/controller/describe_parameters', names=[key])
        assert told.descriptors[0].description == 'damping of both joints [N m s/rad]'
        assert ask.get('controller', 'joint_pd.stiffness') == 900.0
        refused = ask.assign('controller', key, -1.0)
        assert not refused.successful
        assert ask.assign('controller', key, 200.0).successful
        assert ask.assign('plant', 'real_time_factor', 0.0).successful
    finally:
        run.join(120)
    assert done[0].returncode == 0, done[0].stderr
    assert [(c.key, c.value) for c in BagReader(out).config.changes] == [(key, 200.0)]
    verified = flexarm('verify', out)
    assert 'closed loop  6000 messages the same' in verified.stdout, verified.stdout
