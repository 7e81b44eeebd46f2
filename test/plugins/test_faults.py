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

"""Faulty laws and parts of other packages: an error of one line, before the run or in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import flexarm_ros as fa
from flexarm_ros import cli, scenario
from flexarm_ros.core.control import Law
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.parameters.spec import parameter
from flexarm_ros.core.run.answers import PartError, PartInterrupt
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.part import Answer, Column
from flexarm_ros.core.run.parts import PLUGINS, register_part
from flexarm_ros.core.sensing.sensor import Sensor
from flexarm_ros.core.signals import Joints, Signal
from flexarm_ros.scenario.plugins.declarations import check_part
from flexarm_ros.scenario.plugins.registry import LAW_GROUP, PART_GROUP
from nodetools import flexarm
import pytest
from repository import ROOT
from strangertools import forget_installed

TOPIC = 'odd/out'


@dataclass(frozen=True)
class _Keys:
    gain: float = parameter(1.0, 'float', '', 'a gain')


@dataclass(frozen=True)
class _OfEveryNode:
    start_timeout: float = parameter(1.0, 'float', 's', 'a time')


@dataclass(frozen=True)
class _OfRos:
    use_sim_time: bool = parameter(True, 'bool', '', 'a switch')


@dataclass(frozen=True)
class _OddName:
    gain: float = parameter(1.0, 'float', '', 'a gain', key='a gain')


@dataclass(frozen=True)
class _LatencyAsText:
    latency: str = parameter('none', 'str', '', 'a text')


def _signals(*signals: Any) -> Any:
    return classmethod(lambda cls, config: signals)


def _columns(*columns: Column) -> Any:
    return classmethod(lambda cls, config: columns)


def _raise(*_: Any) -> Any:
    raise KeyError('gone')


def _leave(*_: Any) -> Any:
    raise SystemExit(3)


def _interrupt(*_: Any) -> Any:
    raise KeyboardInterrupt


def _made(base: type = Answer, **entries: Any) -> type[Any]:
    """Return the class of a part that publishes one number."""
    held = {
        'NAME': 'odd', 'Parameters': _Keys, '__init__': lambda self, config: None,
        'signals': _signals(Signal(TOPIC, Joints(('x',), ('position',)))),
        'answer': lambda self, k: (1.0,), **entries,
    }  # fmt: skip
    return type('Odd', (base,), held)


def _config(kind: type[Any]) -> RunConfig:
    register_part(kind)
    return scenario.load('pd_tip', ['odd.gain=2', 'duration=0.02'])


@pytest.mark.parametrize(
    ('kind', 'text'),
    [
        (_made(FOR_THE_RECORD=True), 'FOR_THE_RECORD is only for the recorder'),
        (_made(Parameters=_OfEveryNode), 'start_timeout is a parameter of every node'),
        (_made(Parameters=_OfRos), 'use_sim_time is a parameter of every node'),
        (_made(Parameters=_OddName), "'a gain' is not a key of letters"),
        (_made(Sensor, Parameters=_LatencyAsText), "latency is the channel's, a float"),
    ],
)
def test_a_class_with_a_wrong_declaration_is_refused(kind: type[Any], text: str) -> None:
    with pytest.raises(fa.ScenarioError, match=text):
        check_part('odd (test:Odd)', 'odd', kind)
    check_part('odd (test:Odd)', 'odd', _made())


@pytest.mark.parametrize(
    ('entries', 'text'),
    [
        ({'READS': 'plant/state'}, "reads: 'plant/state' is not a tuple of topic names"),
        ({'READS': ('no/topic',)}, 'odd: reads no/topic, which no part of this scenario pub'),
        ({'reads': classmethod(_raise)}, "KeyError: 'gone'"),
        ({'signals': classmethod(_raise)}, "KeyError: 'gone'"),
        ({'check': classmethod(_raise)}, f"odd ({__name__}:Odd): KeyError: 'gone'"),
        ({'signals': classmethod(_leave)}, f'odd ({__name__}:Odd): SystemExit: 3'),
        ({'check': classmethod(_leave)}, f'odd ({__name__}:Odd): SystemExit: 3'),
        ({'signals': _signals()}, 'signals: none'),
        ({'signals': _signals(Signal(TOPIC, None))}, 'is not a Signal with a content'),  # type: ignore[arg-type]
        ({'signals': _signals(Signal('/odd', Joints()))}, '/odd is not a relative topic name'),
        ({'signals': _signals(Signal('a b', Joints()))}, "'a b' is not a valid topic name"),
        ({'signals': _signals(Signal(TOPIC, Joints(), 0))}, 'every is 0, not 1 or more'),
        ({'signals': _signals(Signal('joint_states', Joints()))}, 'is that of encoder'),
        ({'columns': _columns(Column('tip_x', TOPIC, 0))}, 'column tip_x of trajectory.csv'),
        ({'columns': _columns(Column('a,b', TOPIC, 0))}, "'a,b' is not a name of letters"),
        ({'columns': _columns(Column('a', TOPIC, 1))}, 'publishes no value 1 on odd/out'),
        ({'columns': _columns(Column('a', 'reference', 0))}, 'publishes no value 0 on reference'),
    ],
)  # fmt: skip
def test_a_declaration_that_the_scenario_cannot_have_is_named(
    registry: None, entries: dict[str, Any], text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    register_part(_made(**entries))
    assert cli.main(['simulate', 'pd_tip', '--set', 'odd.gain=2', '--out', '/nowhere/x']) == 2
    error = capsys.readouterr().err
    assert text in error
    assert 'odd' in error
    assert len(error.splitlines()) == 1


@pytest.mark.parametrize(
    ('entries', 'text'),
    [
        ({'__init__': _raise}, "odd: KeyError: 'gone'"),
        ({'answer': _raise}, "odd: tick 0: KeyError: 'gone'"),
        ({'answer': lambda self, k: (1.0, 2.0)}, '2 values for odd/out, which has 1'),
        ({'answer': lambda self, k: None}, 'odd: tick 0: TypeError'),
        ({'answer': lambda self, k: ('a',)}, 'odd: tick 0: TypeError'),
        ({'answer': lambda self, k: (1.0 if k < 7 else float('nan'),)},
         'odd: tick 7: ValueError: a value for odd/out is not finite'),
        ({'LATE': True}, 'odd: tick 0: TypeError'),
        ({'LATE': True, 'answer': lambda self, k: (0,)}, '0 values for odd/out, which has 1'),
        ({'LATE': True, 'answer': lambda self, k: (1000000000 + 1000000 * k + (k == 5), 1.0)},
         'odd: tick 5: ValueError: stamp 1005000001 ns of odd/out is after that of the tick'),
        ({'__init__': _leave}, f'odd: SystemExit: 3 ({__name__}:Odd)'),
        ({'answer': _leave}, f'odd: tick 0: SystemExit: 3 ({__name__}:Odd)'),
        ({'__init__': _interrupt}, f'odd: KeyboardInterrupt ({__name__}:Odd)'),
        ({'answer': _interrupt}, f'odd: tick 0: KeyboardInterrupt ({__name__}:Odd)'),
    ],
)  # fmt: skip
def test_a_part_that_fails_in_the_run_is_named_with_its_tick(
    registry: None, tmp_path: Path, entries: dict[str, Any], text: str,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    register_part(_made(**entries))
    words = ('--set', 'odd.gain=2', '--set', 'duration=0.02', '--no-pictures')
    assert cli.main(['simulate', 'pd_tip', *words, '--out', str(tmp_path / 'run')]) == 1
    error = capsys.readouterr().err
    assert text in error
    assert error.startswith('flexarm simulate: error: odd: ')
    assert len(error.splitlines()) == 1


def test_a_part_with_arrays_and_integers_flies(registry: None) -> None:
    import numpy as np

    messages: list[Any] = [np.array([2.0]), [3], (4,)]
    loop = ClosedLoop(_config(_made(answer=lambda self, k: messages[k % 3])))
    found = []
    while (record := loop.tick()) is not None:
        found.append(float(record.messages[-1][0]))
    assert found[:4] == [2.0, 3.0, 4.0, 2.0]


def _law(torque: Callable[..., Any], **entries: Any) -> type[Law]:
    return type('Odd', (Law,), {'torque': torque, **entries})


@pytest.mark.parametrize(
    ('law', 'text'),
    [
        (_law(_raise), r"^controller \(Odd\): tick 0: KeyError: 'gone'"),
        (_law(_raise, __init__=_raise), "^controller: KeyError: 'gone'"),
        (_law(lambda *_: None), r'^controller \(Odd\): tick 0: TypeError'),
        (_law(lambda *_: ('a', 'b')), r'^controller \(Odd\): tick 0: TypeError'),
        (_law(lambda *_: (0.0, 0.0, 0.0)), '3 values for joint_command, which has 2'),
        (_law(_leave), rf'^controller \(Odd\): tick 0: SystemExit: 3 \({__name__}:Odd\)'),
        (_law(_leave, __init__=_leave), rf'^controller: SystemExit: 3 \({__name__}:Odd\)'),
        (_law(_interrupt), r'^controller \(Odd\): tick 0: KeyboardInterrupt'),
    ],
)
def test_a_law_that_fails_is_named_with_its_tick(
    registry: None, law: type[Law], text: str
) -> None:
    with pytest.raises((PartError, PartInterrupt), match=text) as caught:
        fa.simulate('pd_tip', law=law, duration=0.02)
    assert caught.value.__cause__ is not None


LEAVING = """
from flexarm_ros.core.control import Law

class Leaving(Law):
    def torque(self, k, sample):
        if k == 5:
            raise {error}
        return 0.0, 0.0
"""


@pytest.mark.nodes
@pytest.mark.parametrize('error', ['SystemExit(0)', 'KeyboardInterrupt'])
def test_a_node_whose_law_leaves_ends_the_run_with_its_name(
    registry: None, tmp_path: Path, error: str, ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'leaving.py').write_text(LEAVING.format(error=error))
    monkeypatch.setenv('PYTHONPATH', f'{tmp_path}:{ROOT}')
    words = ('--set', 'controller.law=leaving:Leaving', '--set', 'duration=0.05')
    done = flexarm('run', 'pd_tip', '--compose', *words, '--out', tmp_path / 'run')
    assert done.returncode == 1, done.stderr
    said = error.replace('(', ': ').removesuffix(')')
    assert f'controller (leaving:Leaving): tick 5: {said} (leaving:Leaving)' in done.stderr


@pytest.mark.parametrize(
    ('setting', 'named'),
    [
        ('controller.law=leaving:Law', 'controller.law: leaving:Law'),
        ('leaver.gain=1', 'leaver (leaving:Part)'),
    ],
)
def test_a_module_that_ends_the_program_is_named(
    registry: None, tmp_path: Path, setting: str, named: str, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    (tmp_path / 'leaving.py').write_text('import sys\nsys.exit(0)\n')
    _install(tmp_path, monkeypatch, f'[{PART_GROUP}]\nleaver = leaving:Part\n')
    assert cli.main(['simulate', 'pd_tip', '--set', setting, '--out', '/nowhere/x']) == 2
    error = capsys.readouterr().err
    assert f'{named}: cannot be imported: SystemExit: 0' in error
    assert len(error.splitlines()) == 1


def _install(place: Path, monkeypatch: pytest.MonkeyPatch, entry_points: str) -> None:
    """Put a distribution ``rival`` with these entry points on the path."""
    metadata = place / 'rival-1.0.dist-info'
    metadata.mkdir()
    (metadata / 'METADATA').write_text('Metadata-Version: 2.1\nName: rival\nVersion: 1.0\n')
    (metadata / 'entry_points.txt').write_text(entry_points)
    monkeypatch.syspath_prepend(place)
    forget_installed()


def test_an_entry_point_with_a_name_of_ours_is_listed_as_ignored(
    registry: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    taken = (
        f'[{LAW_GROUP}]\npd = rival.laws:Pd\n[{PART_GROUP}]\nimu = rival:Imu\nrun = rival:Run\n'
    )
    _install(tmp_path, monkeypatch, taken)
    assert cli.main(['list', '--parts', '--list-laws']) == 0
    lines = [line.split(None, 1) for line in capsys.readouterr().out.splitlines() if ' ' in line]
    why = 'ignored, the name is one of flexarm_ros: rival'
    assert [name for name, text in lines if text == f'{why} (rival.laws:Pd)'] == ['pd']
    assert [name for name, text in lines if text.startswith(f'{why} (rival:')] == ['imu', 'run']
    assert len([name for name, _ in lines if name == 'pd']) == 2
    scenario.load('pd_tip', ['imu.rate=0'])


def test_a_law_whose_torque_is_not_finite_makes_the_run_unstable(registry: None) -> None:
    law = _law(lambda self, k, sample: (0.0 if k < 5 else float('inf'), 0.0))
    run = fa.simulate('pd_tip', law=law, duration=0.02)
    assert run.stable is False
    assert 'controller (Odd): tick 5: torque at the shoulder is inf' in run.summary['problem']


def test_a_law_has_text_and_array_parameters(registry: None) -> None:
    @dataclass(frozen=True)
    class Own:
        kind: str = parameter('soft', 'str', '', 'kind', choices=('soft', 'hard'))
        gains: tuple[float, ...] = parameter((1.0, 2.0, 3.0), 'floats', '', 'gains', low=0.0)

    def torque(self: Any, k: int, sample: Any) -> Any:
        own = self.parameters
        return (1.0 if own.kind == 'soft' else 2.0), own.gains[-1]

    law = _law(torque, Parameters=Own)
    given = {'Odd': {'kind': 'hard', 'gains': [4.0, 5.0]}}
    run = fa.simulate('pd_tip', law=law, controller=given, duration=0.02)
    assert (run.trajectory['tau1'][0], run.trajectory['tau2'][0]) == (2.0, 5.0)
    read = scenario.from_text(scenario.dump(fa.configure('pd_tip', law=law, controller=given)))
    assert read.controller.own().gains == (4.0, 5.0)
    for wrong, text in (({'kind': 'wet'}, 'one of soft, hard'), ({'gains': [-1.0]}, 'at least 0')):
        with pytest.raises(fa.ScenarioError, match=text):
            fa.configure('pd_tip', law=law, controller={'Odd': wrong})


def test_parts_of_this_package_are_not_wrapped() -> None:
    """The loop costs what it did."""
    assert not PLUGINS
    loop = ClosedLoop(scenario.load('pd_tip'))
    kinds = {name: type(part.answer).__name__ for name, part in loop.answers.parts.items()}
    assert '_Checked' not in kinds.values()
