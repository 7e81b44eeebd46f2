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

"""A sensor from outside this package: in every command where the scenario has its section."""

from __future__ import annotations

from dataclasses import dataclass, replace
import json
from pathlib import Path
import pickle
import threading
from typing import Any, ClassVar

import flexarm_ros as fa
from flexarm_ros import cli, scenario
from flexarm_ros.analysis.report.runs import load_run
from flexarm_ros.bag.checks.digest import digest_of as digest
from flexarm_ros.bag.reading.reader import BagReader
from flexarm_ros.core.parameters.changes import Change
from flexarm_ros.core.parameters.channel import ChannelParameters
from flexarm_ros.core.parameters.sections import (
    changed,
    OWN_LAWS,
    RunConfig,
    SECTIONS,
    with_section,
)
from flexarm_ros.core.parameters.spec import parameter, specs
from flexarm_ros.core.run import part, parts
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.loop_blocks import loop_blocks
from flexarm_ros.core.run.results.columns import COLUMNS
from flexarm_ros.core.signals import Joints, Signal
from flexarm_ros.scenario.plugins import registry as plugins
from flexarm_ros.wire.topics import per_tick_topics
from nodetools import Asker, flexarm, start_node, wait_for
import numpy as np
import pytest
from repository import ROOT
from strangertools import fly_suite, fly_sweep

TOPIC = 'strain_probe/strain'
PROBE = (
    '--set', 'strain_probe.noise_std=1e-4', '--set', 'strain_probe.latency=0.0015',
    '--set', 'strain_probe.gain=0.02', '--set', 'duration=0.2',
)  # fmt: skip
SCENARIO = ('pd_tip', *PROBE)
OVERRIDES = [word for word in PROBE if word != '--set']


def test_a_part_takes_part_where_the_scenario_has_its_section(stranger: Path) -> None:
    plain = scenario.load('pd_tip')
    assert 'strain_probe' not in parts.roles(plain)
    config = scenario.load('pd_tip', OVERRIDES)
    assert parts.roles(config) == (*parts.roles(plain)[:-1], 'strain_probe', 'recorder')
    names = [topic.name for topic in per_tick_topics(config)]
    assert names == [*(topic.name for topic in per_tick_topics(plain)), TOPIC]
    assert parts.readers(TOPIC, config) == ('recorder',)
    assert scenario.load('pd_tip') == plain
    empty = scenario.from_dict({'strain_probe': {}})
    assert empty.section('strain_probe').gain == 0.01
    assert 'strain_probe' in scenario.to_dict(empty)
    assert scenario.from_text(scenario.dump(config)) == config
    assert scenario.from_dict(scenario.to_dict(config)) == config
    louder = scenario.with_values(config, ['strain_probe.gain=0.5'])
    assert louder.section('strain_probe') == replace(config.section('strain_probe'), gain=0.5)


def test_its_measurement_has_its_gain_latency_and_noise(stranger: Path) -> None:
    exact = scenario.load('pd_tip', ['strain_probe.gain=0.02', 'duration=0.1'])
    late = scenario.with_values(exact, ['strain_probe.latency=0.0015'])
    noisy = scenario.with_values(late, ['strain_probe.noise_std=1e-4', 'seed=3'])

    def flown(config: RunConfig) -> tuple[list[Any], np.ndarray[Any, Any]]:
        loop, ends = ClosedLoop(config), []
        place, messages = loop.answers.places[TOPIC], []
        while (record := loop.tick()) is not None:
            messages.append(record.messages[place])
            ends.append(record.deflections[:2])
        return messages, np.array(ends)

    told, ends = flown(exact)
    assert [message[1:] for message in told] == [tuple(0.02 * end) for end in ends]
    delayed, _ = flown(late)
    assert delayed[40][0] == told[40][0] - 1_500_000
    assert delayed[40][1:] == pytest.approx(tuple(0.01 * (ends[38] + ends[39])), rel=1e-12)
    errors = np.array([m[1:] for m in flown(noisy)[0]]) - np.array([m[1:] for m in delayed])
    assert 0.8e-4 < errors.std() < 1.2e-4
    assert flown(noisy)[0] == flown(noisy)[0]


def test_its_channel_has_jitter_and_loss(stranger: Path) -> None:
    settings = ['strain_probe.jitter=0.004', 'strain_probe.dropout=0.2', 'strain_probe.rate=500']
    config = scenario.load('pd_tip', [*OVERRIDES, *settings])
    assert pickle.loads(pickle.dumps(config)) == config  # as the workers of a sweep get it
    loop, stamps = ClosedLoop(config), []
    place = loop.answers.places[TOPIC]
    while (record := loop.tick()) is not None:
        stamps.append(record.messages[place][0])
    assert stamps == sorted(stamps)
    assert 0.1 < len(set(stamps)) / len(stamps) < 0.5


def test_in_every_command_without_nodes(
    stranger: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(['list', '--parts']) == 0
    assert f'strain_probe  {TOPIC} (optional, stranger-arm)' in capsys.readouterr().out
    out = tmp_path / 'run'
    assert cli.main(['simulate', *SCENARIO, '--no-pictures', '--out', str(out)]) == 0
    summary = json.loads((out / 'summary.json').read_text())
    held = summary['scenario']['strain_probe']
    own = {'gain': 0.02, 'latency': 0.0015, 'noise_std': 1e-4}
    assert {key: held.pop(key) for key in own} == own
    assert {'jitter', 'dropout', 'rate'} <= held.keys() < set(specs(ChannelParameters))
    header, *rows = (out / 'trajectory.csv').read_text().splitlines()
    assert header == ','.join((*COLUMNS, 'strain1', 'strain2'))
    reader = BagReader(out)
    block = next(reader.blocks())
    assert [float(v) for v in rows[9].split(',')[-2:]] == block.values[-1][9].tolist()
    capsys.readouterr()
    assert cli.main(['verify', str(out)]) == 0
    told = capsys.readouterr().out
    assert 'strain_probe 200 messages the same' in told
    assert 'closed loop  1400 messages the same' in told
    assert cli.main(['verify', str(out), '--without', 'strain_probe']) == 0
    assert 'external, taken as recorded: strain_probe' in capsys.readouterr().out
    assert cli.main(['verify', str(out), '--without', 'imu']) == 2
    assert 'no part imu: controller, encoder, plant, strain_probe' in capsys.readouterr().err
    assert cli.main(['report', str(out), '--out', str(tmp_path / 'page')]) == 0
    assert (tmp_path / 'page' / 'parts.svg').exists()
    assert list(load_run(out).optional()) == ['strain1, m/m', 'strain2, m/m']
    assert cli.main(['export', str(out), '--out', str(tmp_path / 'rows')]) == 0
    rows = (tmp_path / 'rows' / 'strain_probe_strain.csv').read_text().splitlines()
    assert rows[0] == 'tick,stamp_ns,position.link1,position.link2'
    assert len(rows) == 201
    assert (tmp_path / 'rows' / 'trajectory.csv').read_text() == (
        out / 'trajectory.csv'
    ).read_text()
    assert cli.main(['compare', str(out), str(out)]) == 0
    assert cli.main(['recover', str(out), '--out', str(tmp_path / 'rescued')]) == 0
    assert digest(tmp_path / 'rescued') == digest(out)
    run = fa.load(out)
    assert run.columns == (*COLUMNS, 'strain1', 'strain2')
    again = fa.simulate(scenario.load('pd_tip', OVERRIDES))
    assert np.array_equal(again.to_numpy(), run.to_numpy(), equal_nan=True)


def test_from_python_a_section_is_a_keyword(stranger: Path) -> None:
    config = fa.configure('pd_tip', strain_probe={'gain': 0.02}, duration=0.1)
    assert config == scenario.load('pd_tip', ['strain_probe.gain=0.02', 'duration=0.1'])
    run = fa.simulate('pd_tip', strain_probe={}, duration=0.1)  # its defaults
    assert run.columns == (*COLUMNS, 'strain1', 'strain2')
    with pytest.raises(fa.ScenarioError, match='strain_probe.gian: unknown key'):
        fa.simulate('pd_tip', strain_probe={'gian': 1.0})
    with pytest.raises(fa.ScenarioError, match="did you mean 'strain_probe'"):
        fa.simulate('pd_tip', strain_prob={'gain': 1.0})


def test_a_changed_message_of_the_part_is_found(stranger: Path, tmp_path: Path) -> None:
    from flexarm_ros.bag.checks.verify import verify
    from flexarm_ros.bag.recording import BAG
    from flexarm_ros.bag.simulation import simulate
    from flexarm_ros.bag.writer import BagWriter

    config = scenario.load('pd_tip', OVERRIDES)
    simulate(config, tmp_path / 'right')
    assert verify(tmp_path / 'right').same
    (tmp_path / 'wrong').mkdir()
    provenance = BagReader(tmp_path / 'right').provenance
    with BagWriter(tmp_path / 'wrong' / BAG, config, provenance) as writer:
        for block in loop_blocks(ClosedLoop(config)):
            block.values[-1][50] += 1.0
            writer.write_block(block)
    verdict = verify(tmp_path / 'wrong')
    assert verdict.differing == {'strain_probe': 1, 'closed loop': 1}


def test_suite_and_sweep(stranger: Path, tmp_path: Path) -> None:
    base = tmp_path / 'own.yaml'
    base.write_text(
        'strain_probe:\n  ros__parameters: {gain: 0.02}\n'
        '/**:\n  ros__parameters: {duration: 0.1}\n'
    )
    fly_suite(base, tmp_path / 'suite')
    assert TOPIC in {t.name for t in BagReader(tmp_path / 'suite' / 'own').topics}
    fly_sweep(base, '  strain_probe.gain: [0.01, 0.02]\n', tmp_path / 'sweep')


@pytest.mark.parametrize(
    ('setting', 'text'),
    [
        ('strain_probe.gain=-1', 'strain_probe.gain: -1 is out of range; it must be at least 0'),
        ('strain_probe.gian=1', "unknown key; did you mean 'strain_probe.gain'?"),
        ('strain_prob.gain=1', "strain_prob.gain: unknown key; did you mean 'strain_probe.gain'?"),
    ],
)
def test_a_bad_key_is_named(
    stranger: Path, setting: str, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ['simulate', *SCENARIO, '--set', setting, '--out', '/nowhere/x']
    assert cli.main(words) == 2
    error = capsys.readouterr().err
    assert text in error
    assert len(error.splitlines()) == 1


def test_a_latency_that_the_run_cannot_hold_is_named(stranger: Path) -> None:
    long = ['control_period=2e-7', 'duration=0.2', 'strain_probe.latency=0.5']
    with pytest.raises(
        fa.ScenarioError, match=r'strain_probe.latency: 0.5 s is more than 1000000'
    ):
        scenario.load('pd_tip', long)
    config = scenario.load('pd_tip', OVERRIDES)
    odd = replace(config.section('strain_probe'), latency=1e-10)
    with pytest.raises(ValueError, match=r'strain_probe\.latency'):
        parts.check_parts(with_section(config, 'strain_probe', odd))


@pytest.mark.parametrize(
    ('column', 'topic', 'text'),
    [
        ('strain1', 'probe/x', 'column strain1 of trajectory.csv is that of strain_gauge'),
        ('tau1', 'probe/x', 'column tau1 of trajectory.csv is that of every run'),
        ('probe', 'strain_gauge/strain', 'topic strain_gauge/strain is that of strain_gauge'),
        ('probe', 'plant/timing', 'topic plant/timing is reserved'),
    ],
)
def test_names_of_another_part_are_refused(
    stranger: Path, column: str, topic: str, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before anything is started, whatever the order of the parts; both are named."""
    settings = ['strain_probe.gain=0.02', 'strain_gauge.output=angle']
    scenario.load('pd_tip', settings[:1])
    probe = parts.part_of('strain_probe')
    told = (part.Column(column, topic, 0),)
    signal = Signal(topic, Joints(('link1', 'link2'), ('position',)))
    monkeypatch.setattr(probe, 'columns', classmethod(lambda _cls, _config: told))
    monkeypatch.setattr(probe, 'signals', classmethod(lambda _cls, _config: (signal,)))
    with pytest.raises(fa.ScenarioError, match=rf'^strain_probe: {text}'):
        scenario.load('pd_tip', settings)


@pytest.mark.parametrize(
    ('group', 'name', 'settings'),
    [
        (plugins.PART_GROUP, 'strain_probe', ['strain_probe.gain=0.02']),
        (plugins.LAW_GROUP, 'joint_pd', ['controller.law=joint_pd']),
    ],
)
def test_a_name_of_two_packages_is_refused(
    stranger: Path, tmp_path: Path, group: str, name: str, settings: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    scenario.load('pd_tip', settings)
    other = tmp_path / 'rival-1.0.dist-info'
    other.mkdir()
    (other / 'METADATA').write_text('Metadata-Version: 2.1\nName: rival\nVersion: 1.0\n')
    (other / 'entry_points.txt').write_text(f'[{group}]\n{name} = rival.module:Thing\n')
    monkeypatch.syspath_prepend(tmp_path)
    for held in (parts.PLUGINS, SECTIONS, OWN_LAWS):
        held.pop(name, None)  # as in a new process
    plugins.installed_parts.cache_clear()
    plugins.installed_laws.cache_clear()
    with pytest.raises(fa.ScenarioError, match=rf'{name}: 2 .*rival\.module:Thing of rival'):
        scenario.load('pd_tip', settings)


def test_a_live_parameter(stranger: Path) -> None:
    config = scenario.load('pd_tip', ['strain_probe.gain=0.02', 'duration=0.1'])
    change = Change(60, 'strain_probe', 'gain', 0.04)
    loop = ClosedLoop(replace(config, changes=(change,)))
    ratios = set()
    while (record := loop.tick()) is not None:
        message = record.messages[loop.answers.places[TOPIC]]
        if record.deflections[0] != 0.0:
            ratios.add((record.k >= 60, round(message[1] / record.deflections[0], 12)))
    assert ratios == {(False, 0.02), (True, 0.04)}
    assert changed(config, change).section('strain_probe').gain == 0.04
    late = scenario.with_values(config, ['strain_probe.latency=0.5'])
    loop.answers.parts['strain_probe'].check_live(late)


@pytest.mark.usefixtures('stranger')
@pytest.mark.parametrize('case', sorted(scenario.shipped()))
def test_shipped_cases_are_as_they_were(case: str) -> None:
    config = scenario.load(case)
    there = [p for p in parts.PARTS if p.Parameters is None or config.section(p.NAME) is not None]
    assert list(parts.parts_of(config)) == there
    if config.further:
        assert case in {'lab_arm', 'quanser_2dsfl'}
    else:
        assert len(per_tick_topics(config)) == 6 + len(config.tip_sensor.more_locations or ())


def test_where_the_package_is_not_installed_its_part_is_taken_as_recorded(
    stranger: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing that the bag names is imported, and the rest is verified."""
    out = tmp_path / 'run'
    assert flexarm('simulate', *SCENARIO, '--no-pictures', '--out', out).returncode == 0
    # The module is there, but no entry point names it.
    mark, place = tmp_path / 'imported', tmp_path / 'site'
    place.mkdir()
    text = f'from pathlib import Path\nPath({str(mark)!r}).touch()\n'
    for name in ('strain_probe', 'stranger_arm'):
        (place / f'{name}.py').write_text(text)
    monkeypatch.setenv('PYTHONPATH', f'{place}:{ROOT}')
    verified = flexarm('verify', out)
    assert verified.returncode == 0, verified.stderr + verified.stdout
    assert 'closed loop not computed: strain_probe unknown here' in verified.stdout
    assert 'controller   200 messages the same' in verified.stdout
    for words in (
        ('report', out, '--out', tmp_path / 'page'),
        ('export', out, '--out', tmp_path / 'rows'),
        ('compare', out, out),
        ('recover', out, '--out', tmp_path / 'rescued'),
    ):
        done = flexarm(*words)
        assert done.returncode == 0, (words, done.stderr)
    assert digest(tmp_path / 'rescued') == digest(out)
    refused = flexarm('simulate', *SCENARIO, '--out', tmp_path / 'other')
    assert refused.returncode == 2
    assert 'strain_probe.noise_std: unknown key' in refused.stderr
    assert not mark.exists()


@dataclass(frozen=True)
class _Keys:
    gain: float = parameter(1.0, 'float', '', 'a gain')


@dataclass(frozen=True)
class _Unset:
    gain: float | None = parameter(None, 'float', '', 'a gain')


def _declared(**entries: Any) -> type:
    held = {'NAME': 'odd', 'Parameters': _Keys, 'signals': classmethod(lambda *_: ()), **entries}
    return type('Odd', (part.Answer,), held)


class _Point:
    """An entry point of a class that is at hand."""

    value, module, attr, dist = 'test:Odd', __name__, 'ODD', None


ODD: Any = None


@pytest.mark.parametrize(
    ('made', 'text'),
    [
        (dict, 'not a subclass of flexarm_ros.core.run.part.Answer'),
        (_declared(NAME='other'), "NAME is not 'odd'"),
        (_declared(Parameters=None), 'Parameters is not a frozen dataclass'),
        (_declared(Parameters=_Unset), 'Parameters has no key with a default'),
    ],
)
def test_a_class_that_is_no_part_is_refused(
    registry: None, monkeypatch: pytest.MonkeyPatch, made: Any, text: str
) -> None:
    monkeypatch.setattr(plugins, 'installed_parts', lambda: {'odd': _Point})
    monkeypatch.setitem(globals(), 'ODD', made)
    with pytest.raises(fa.ScenarioError, match=text):
        scenario.from_dict({'odd': {}})
    assert parts.PLUGINS == {}


class _Follower(part.Answer):
    """A part that reads another one's topic."""

    NAME: ClassVar[str] = 'follower'
    Parameters: ClassVar[type | None] = _Keys
    READS: ClassVar[tuple[str, ...]] = (TOPIC,)

    def __init__(self, config: RunConfig) -> None:
        pass

    @classmethod
    def signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        return (Signal('follower/strain', Joints(('link1', 'link2'), ('position',))),)

    def answer(self, k: int, strain: Any) -> Any:
        return strain


def test_a_part_may_read_another_one_s_topic_if_it_is_there(stranger: Path) -> None:
    parts.register_part(_Follower)  # before the one that it reads
    with pytest.raises(fa.ScenarioError, match=f'follower: reads {TOPIC}, which no part'):
        scenario.from_dict({'follower': {}})
    config = scenario.load('pd_tip', ['follower.gain=1', *OVERRIDES])
    assert parts.roles(config)[-3:] == ('strain_probe', 'follower', 'recorder')
    loop = ClosedLoop(config)
    for _ in range(5):
        record = loop.tick()
        assert record is not None
        strain = record.messages[loop.answers.places[TOPIC]]
        assert record.messages[loop.answers.places['follower/strain']] == strain[1:]


@pytest.mark.nodes
def test_nodes_give_the_bytes_of_simulate_and_replay(
    stranger: Path, tmp_path: Path, ros_domain: int
) -> None:
    words = (*SCENARIO, '--no-pictures')
    assert flexarm('simulate', *words, '--out', tmp_path / 'simulate').returncode == 0
    digests = [digest(tmp_path / 'simulate')]
    for name, more in (('run', ()), ('composed', ('--compose',))):
        done = flexarm('run', *words, *more, '--out', tmp_path / name)
        assert done.returncode == 0, done.stderr
        digests.append(digest(tmp_path / name))
    assert len(set(digests)) == 1
    assert (tmp_path / 'run' / 'logs' / 'strain_probe.log').exists()
    assert (tmp_path / 'run' / 'trajectory.csv').read_text() == (
        tmp_path / 'simulate' / 'trajectory.csv'
    ).read_text()
    played = flexarm(
        'replay', tmp_path / 'run', '--rate', '0', '--delay', '0', '--domain', str(ros_domain),
        '--topics', TOPIC,
    )  # fmt: skip
    assert played.returncode == 0, played.stderr


@pytest.mark.nodes
def test_its_parameter_is_described_and_set_while_the_run_goes_on(
    stranger: Path, tmp_path: Path, ros_domain: int, rclpy_node: Any
) -> None:
    from rcl_interfaces.srv import DescribeParameters

    ask = Asker(*rclpy_node)
    out, done = tmp_path / 'run', []
    words = ('run', *SCENARIO, '--set', 'duration=1.0', '--rtf', '0.05', '--no-pictures',
             '--out', out)  # fmt: skip
    run = threading.Thread(target=lambda: done.append(flexarm(*words)))
    run.start()
    try:
        wait_for(lambda: ask.tick() > 20, 60, 'the run has begun')
        told = ask.call(DescribeParameters, '/strain_probe/describe_parameters', names=['gain'])
        assert told.descriptors[0].description == 'strain per end deflection [1/m]'
        assert ask.get('strain_probe', 'latency') == 0.0015
        assert not ask.assign('strain_probe', 'gain', -1.0).successful
        assert ask.assign('strain_probe', 'gain', 0.5).successful
        assert ask.assign('plant', 'real_time_factor', 0.0).successful
    finally:
        run.join(120)
    assert done[0].returncode == 0, done[0].stderr
    assert [(c.node, c.key, c.value) for c in BagReader(out).config.changes] == [
        ('strain_probe', 'gain', 0.5)
    ]
    verified = flexarm('verify', out)
    assert 'closed loop  7000 messages the same' in verified.stdout, verified.stdout


@pytest.mark.nodes
def test_by_hand_each_node_must_have_the_section(
    stranger: Path, tmp_path: Path, ros_domain: int
) -> None:
    """The probe's node takes part; those that do not know of it say so instead of hanging."""
    from nodetools import finish

    with_probe, without = tmp_path / 'with.yaml', tmp_path / 'without.yaml'
    with_probe.write_text(scenario.dump(scenario.load('pd_tip', OVERRIDES)))
    without.write_text(scenario.dump(scenario.load('pd_tip', ['duration=0.2'])))
    roles = parts.roles(scenario.load('pd_tip', OVERRIDES))
    own = ('-p', f'recorder:output:={tmp_path / "run"}')
    nodes = [start_node(role, with_probe, *own) for role in roles]
    texts = finish(nodes)
    assert [node.returncode for node in nodes] == [0] * len(roles), texts
    assert flexarm('verify', tmp_path / 'run').returncode == 0
    nodes = [
        start_node(role, without if role == 'encoder' else with_probe, '-p', 'start_timeout:=20.0')
        for role in roles
    ]
    texts = finish(nodes)
    assert {node.returncode for node in nodes} == {1}
    assert any('optional parts of the scenario' in text for text in texts), texts
