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

"""``flexarm verify`` finds every alteration and names tick, topic and field."""

from __future__ import annotations

from collections.abc import Callable, Iterable
import json
from pathlib import Path
import sys
from typing import Any

from bagtools import OPEN_LOOP, small_config, small_messages, write_small
from flexarm_ros import scenario
from flexarm_ros.bag import embedded_metadata as frontmatter
from flexarm_ros.bag import provenance
from flexarm_ros.bag import writer as bag_writer
from flexarm_ros.bag.checks.verify import verify
from flexarm_ros.bag.errors import BagContentError
from flexarm_ros.bag.mcap.scan import Scanner
from flexarm_ros.bag.provenance import Provenance
from flexarm_ros.bag.reading.reader import BagReader
from flexarm_ros.bag.writer import BagWriter
from flexarm_ros.cli import main
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.parts import recorded_roles
from flexarm_ros.wire.generic_decode import typestore
from flexarm_ros.wire.topics import COMMAND, per_tick_topics, STATE
import pytest

CONFIG = small_config('encoder.latency=0.0005', 'tip_sensor.latency=0.0015')
TOPICS = per_tick_topics(CONFIG)


def write_messages(
    directory: Path,
    config: RunConfig,
    alter: Callable[[int, int, bytes], bytes | None] = lambda tick, topic, data: data,
    ticks: Iterable[int] | None = None,
    origin: Provenance | None = None,
) -> Path:
    """Write the simulation of ``config``, each message as ``alter`` gives it."""
    truth = small_messages(config)
    wanted = range(len(truth)) if ticks is None else ticks
    with BagWriter(directory, config, origin) as writer:
        for tick in wanted:
            for topic, data in enumerate(truth[tick]):
                altered = alter(tick, topic, data)
                if altered is not None:
                    writer.write(topic, tick, altered)
            writer.end_tick(tick)
    return directory


def changed(topic: int, field: int, data: bytes) -> bytes:
    """Return a message with the last bit of one value flipped."""
    stamp, values = TOPICS[topic].codec.decode(data)
    import numpy as np

    numbers = np.array(values)
    numbers.view(np.int64)[field] ^= 1
    return TOPICS[topic].codec.encode(stamp, *numbers)


@pytest.mark.parametrize(
    'overrides',
    [
        (),
        ('controller.law=pd', 'controller.velocity_source=encoder', 'plant.modes=2'),
        ('encoder.noise_std=1e-4', 'encoder.resolution=1e-5', 'tip_sensor.noise_std=0.001'),
        ('tip_sensor.rate=100', 'tip_sensor.measurand=elastic', 'controller.feedback=encoder'),
        ('tip_sensor.latency=0.0013', 'tip_sensor.latency_model=pade2', 'trajectory.delay=0.0123'),
        ('plant.model=full', 'control_period=0.002'),
    ],
)
def test_sound_run(overrides: tuple[str, ...], tmp_path: Path) -> None:
    config = small_config(*overrides)
    write_small(tmp_path / 'bag', config)
    verdict = verify(tmp_path / 'bag')
    assert verdict.same
    assert not verdict.notes
    assert not verdict.versions
    ticks = round(config.run.duration / config.run.control_period)
    assert verdict.ticks == verdict.planned == ticks
    assert verdict.compared == {
        'plant': 2 * ticks, 'encoder': ticks, 'tip_sensor': ticks, 'trajectory': ticks,
        'controller': ticks, 'closed loop': 6 * ticks,
    }  # fmt: skip


def test_open_loop_from_the_bag_alone(tmp_path: Path) -> None:
    config = scenario.from_dict(
        {
            'run': {'duration': 0.2},
            'controller': {'law': 'open_loop', 'torque_file': '/not/there.csv'},
        },
        OPEN_LOOP,
    )
    write_small(tmp_path / 'bag', config)
    assert b'/not/there' not in (tmp_path / 'bag' / 'bag_0.mcap').read_bytes()
    assert verify(tmp_path / 'bag').same


@pytest.mark.parametrize(
    ('topic', 'field'), [(t, f) for t in range(1, 6) for f in range(len(TOPICS[t].codec.fields))]
)
def test_one_bit_in_the_middle(topic: int, field: int, tmp_path: Path) -> None:
    bag = write_messages(
        tmp_path / 'bag',
        CONFIG,
        lambda k, t, data: changed(topic, field, data) if (k, t) == (137, topic) else data,
    )
    verdict = verify(bag)
    assert not verdict.same
    first = verdict.earliest
    assert first is not None
    assert (first.tick, first.topic) == (137, TOPICS[topic].path)
    assert first.field == TOPICS[topic].codec.fields[field]
    assert first.check == TOPICS[topic].node
    assert verdict.first['closed loop'].tick == 137


@pytest.mark.parametrize('topic', range(6))
def test_a_stamp(topic: int, tmp_path: Path) -> None:
    def alter(tick: int, index: int, data: bytes) -> bytes:
        if (tick, index) != (50, topic):
            return data
        stamp, values = TOPICS[topic].codec.decode(data)
        return TOPICS[topic].codec.encode(stamp + 1, *values)

    first = verify(write_messages(tmp_path / 'bag', CONFIG, alter)).earliest
    assert first is not None
    assert (first.tick, first.topic, first.field) == (50, TOPICS[topic].path, 'stamp')


def test_not_a_number(tmp_path: Path) -> None:
    def alter(tick: int, index: int, data: bytes) -> bytes:
        nan = float('nan')
        stamp = TOPICS[index].codec.decode(data)[0]
        at = (tick, index) == (50, COMMAND)
        return TOPICS[index].codec.encode(stamp, nan, nan) if at else data

    first = verify(write_messages(tmp_path / 'bag', CONFIG, alter)).earliest
    assert first is not None
    assert (first.tick, first.field, first.recorded) == (50, 'effort.shoulder', 'nan')


def test_another_scenario(tmp_path: Path) -> None:
    """Messages of one gain under the scenario of another."""
    other = small_config('controller.ks=15.000000001')
    truth = small_messages(small_config())
    with BagWriter(tmp_path / 'bag', other) as writer:
        for tick, messages in enumerate(truth):
            for topic, data in enumerate(messages):
                writer.write(topic, tick, data)
    verdict = verify(tmp_path / 'bag')
    first = verdict.earliest
    assert first is not None
    assert (first.tick, first.topic, first.check) == (0, '/joint_command', 'controller')
    assert set(verdict.first) == {'controller', 'closed loop'}


def test_cut_off_is_compared_as_far_as_it_goes(tmp_path: Path) -> None:
    bag = write_messages(tmp_path / 'bag', CONFIG)
    path = bag / 'bag_0.mcap'
    path.write_bytes(path.read_bytes()[:60000])
    verdict = verify(path)
    assert not verdict.same and not verdict.first
    assert 0 < verdict.ticks < verdict.planned
    assert ['damaged at byte' in fault for fault in verdict.faults] == [True]
    assert main(['compare', str(path), str(path)]) == 1
    # A run that says that it was not completed explains the cut; one that was does not.
    for complete in (True, False):
        (tmp_path / 'summary.json').write_text(json.dumps({'complete': complete}))
        assert verify(path).same == (not complete)
    assert any('damaged at byte' in note for note in verify(path).notes)


def test_a_report_of_a_cut_bag_says_so_on_the_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_small(tmp_path / 'bag', small_config())
    path.write_bytes(path.read_bytes()[:60000])
    assert main(['report', str(path), '--no-pictures', '--out', str(tmp_path / 'page')]) == 0
    assert 'damaged: ' in capsys.readouterr().err


def test_nothing_recorded_is_nothing_proved(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sound = write_small(tmp_path / 'bag', small_config()).read_bytes()
    with Scanner(tmp_path / 'bag' / 'bag_0.mcap') as scanner:
        front = next(r.offset for r in scanner.records(bodies=False) if r.opcode == 0x06)
    (tmp_path / 'front.mcap').write_bytes(sound[:front])
    verdict = verify(tmp_path / 'front.mcap')
    assert not verdict.same
    assert verdict.faults[0] == 'no message in it: nothing is verified'
    assert len(verdict.faults) == 2 and 'the file is truncated' in verdict.faults[1]
    assert main(['verify', str(tmp_path / 'front.mcap')]) == 1
    assert 'the same' not in capsys.readouterr().out


def test_ended_early_with_an_incomplete_tick(tmp_path: Path) -> None:
    bag = write_messages(
        tmp_path / 'bag',
        CONFIG,
        lambda k, t, data: None if k == 120 and t == COMMAND else data,
        range(121),
    )
    verdict = verify(bag)
    assert verdict.same
    assert verdict.ticks == 120
    assert 'tick 120: no message on /joint_command' in verdict.notes
    assert any('ends at tick 120 of 300' in note for note in verdict.notes)


def test_unstable_run(tmp_path: Path) -> None:
    config = small_config('control_period=0.02', 'duration=4', 'plant.hub_inertia=[0.5,0.5]')
    write_small(tmp_path / 'bag', config)
    verdict = verify(tmp_path / 'bag')
    assert verdict.same
    assert verdict.ticks < verdict.planned
    assert any('unstable as computed' in note for note in verdict.notes)


def test_missing_message_and_missing_ticks(tmp_path: Path) -> None:
    lost = write_messages(
        tmp_path / 'a', CONFIG, lambda k, t, data: None if (k, t) == (70, STATE) else data
    )
    verdict = verify(lost)
    assert verdict.faults == ['tick 70: no message on /plant/state']
    assert not verdict.same
    assert not verdict.first
    gap = write_messages(tmp_path / 'b', CONFIG, ticks=[*range(100), *range(150, 300)])
    verdict = verify(gap)
    assert len(verdict.faults) == 1
    assert verdict.faults[0].startswith('ticks 100 to 149 are missing')
    assert not verdict.first
    assert verdict.ticks == 250


def test_foreign_controller(tmp_path: Path) -> None:
    """Another layout with the same numbers is no difference; other torques are, unless told."""
    store = typestore()
    joint_state = store.types['sensor_msgs/msg/JointState']
    header = store.types['std_msgs/msg/Header']
    time = store.types['builtin_interfaces/msg/Time']
    import numpy as np

    def foreign(data: bytes, scale: float) -> bytes:
        stamp, (tau1, tau2) = TOPICS[COMMAND].codec.decode(data)
        sec, nanosec = divmod(stamp, 10**9)
        message = joint_state(
            header(time(sec, nanosec), 'mine'),
            ['elbow', 'shoulder'],
            np.zeros(0),
            np.zeros(0),
            np.array([tau2, tau1]) * scale,
        )
        return bytes(store.serialize_cdr(message, 'sensor_msgs/msg/JointState'))

    same = write_messages(
        tmp_path / 'a', CONFIG, lambda k, t, data: foreign(data, 1.0) if t == COMMAND else data
    )
    assert verify(same).same
    other = write_messages(
        tmp_path / 'b', CONFIG, lambda k, t, data: foreign(data, 1.5) if t == COMMAND else data
    )
    first = verify(other).earliest
    assert first is not None
    assert (first.check, first.tick) == ('controller', 0)
    verdict = verify(other, ['controller'])
    assert set(verdict.first) == {'plant'}  # these torques moved another arm
    assert verdict.first['plant'].tick == 1
    told = write_messages(
        tmp_path / 'c', CONFIG, origin=Provenance.here('', ['controller']),
        alter=lambda k, t, data: foreign(data, 1.0) if t == COMMAND else data,
    )  # fmt: skip
    verdict = verify(told)
    assert verdict.same
    assert 'controller' not in verdict.compared
    assert any('closed loop not computed' in note for note in verdict.notes)


def test_says_that_versions_differ(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here = Provenance.here()
    then = Provenance('', {**here.versions, 'numpy': '1.0.0'}, here.commit, here.digest)
    bag = write_messages(tmp_path / 'bag', CONFIG, origin=then)
    verdict = verify(bag)
    assert verdict.same
    assert verdict.versions == [f'numpy 1.0.0, here {here.versions["numpy"]}']
    assert not verdict.other_source
    monkeypatch.setattr(provenance, '_digest', lambda: '0' * 64)
    verdict = verify(bag)
    assert verdict.other_source
    assert any('source' in text for text in verdict.versions)


@pytest.mark.parametrize(
    ('digest', 'said'), [('', 'the source is the same'), ('00', 'other source')]
)
def test_says_what_should_have_been_the_same(
    digest: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    here = Provenance.here()
    origin = Provenance('', here.versions, here.commit, digest or here.digest)
    bag = write_messages(
        tmp_path / 'bag', CONFIG, origin=origin,
        alter=lambda k, t, data: data[:-1] + b'\x01' if t == COMMAND else data,
    )  # fmt: skip
    assert main(['verify', str(bag)]) == 1
    out = capsys.readouterr().out
    assert said in out
    assert ('the source is the same' in out) == (not digest)


def test_metadata_that_counts_otherwise(tmp_path: Path) -> None:
    bag = write_messages(tmp_path / 'bag', CONFIG)
    path = bag / 'metadata.yaml'
    path.write_text(
        path.read_text().replace('  message_count: 300\n', '  message_count: 299\n', 1)
    )
    verdict = verify(bag)
    assert verdict.faults == ['metadata.yaml: 299 messages on /clock, the bag has 300']
    path.unlink()
    assert verify(bag).same


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good = write_messages(tmp_path / 'good', CONFIG)
    assert main(['verify', str(good)]) == 0
    assert capsys.readouterr().out.endswith('the same\n')
    bad = write_messages(
        tmp_path / 'bad',
        CONFIG,
        lambda k, t, data: changed(4, 2, data) if k >= 200 and t == 4 else data,
    )
    assert main(['verify', str(bad)]) == 1
    out = capsys.readouterr().out
    assert 'DIFFERS: tick 200, /reference twist.linear.x: ' in out
    assert '100 of 300 messages differ' in out
    assert main(['verify', str(tmp_path)]) == 1
    err = capsys.readouterr().err
    assert err.count('\n') == 1
    assert 'no bag in it' in err


def test_several_runs_are_verified_and_what_is_none_is_skipped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good, also = (str(write_messages(tmp_path / name, CONFIG)) for name in ('good', 'also'))
    for name, file in (('page', 'report.html'), ('sweep', 'sweep.json')):
        (tmp_path / name).mkdir()
        (tmp_path / name / file).touch()
    others = [str(tmp_path / 'page'), str(tmp_path / 'sweep')]
    assert main(['verify', good, *others, also]) == 0
    said = capsys.readouterr()
    assert said.out.count('\nthe same\n') == 2
    assert said.err.splitlines() == [
        f'flexarm verify: {others[0]}: skipped, a report',
        f'flexarm verify: {others[1]}: skipped, a sweep',
    ]
    assert main(['verify', str(tmp_path / 'none'), good]) == 1
    said = capsys.readouterr()
    assert 'NOT VERIFIED: ' in said.out and said.out.endswith('the same\n')
    assert main(['verify', *others]) == 2


def test_a_topic_that_is_missing_throughout_is_no_ragged_end(tmp_path: Path) -> None:
    silent = write_messages(
        tmp_path / 'a', CONFIG, lambda k, t, data: None if t == STATE else data
    )
    verdict = verify(silent)
    assert not verdict.same
    assert verdict.faults == ['300 of the ticks 0 to 299: no message on /plant/state']


def write_as_another_version(
    monkeypatch: pytest.MonkeyPatch, directory: Path, *edits: tuple[str, str], **options: Any
) -> Path:
    """Write a bag whose scenario has what this version does not know."""
    with monkeypatch.context() as patch:

        def attached(
            config: RunConfig, text: str, origin: Provenance
        ) -> list[tuple[str, str, str]]:
            found = frontmatter.attachments(config, text, origin)
            for old, new in edits:
                assert old in text
                text = text.replace(old, new)
            return [(*found[0][:2], text), *found[1:]]

        patch.setattr(bag_writer, 'attachments', attached)
        return write_messages(directory, CONFIG, **options)


LAW = ('law: "fls"', 'law: "evil_law:Law"\n    evil: {gain: 3.0}')
SECTION = ('plant:\n', 'lidar:\n  ros__parameters:\n    rate: 100.0\nplant:\n')
KEY = ('    location: 9.0\n', '    location: 9.0\n    smear: 0.001\n')
CHOICE = ('kind: "square"', 'kind: "spline"')
RUN_KEY = ('    seed: 0\n', '    seed: 0\n    burst_limit: 100\n')


@pytest.mark.parametrize(
    ('edit', 'section', 'said', 'left'),
    [
        (
            LAW,
            'controller',
            'law: evil_law:Law is not known (--trust evil_law uses it); unknown key evil',
            'controller',
        ),
        (SECTION, 'lidar', 'unknown section', ''),
        (KEY, 'tip_sensor', 'unknown key smear', 'tip_sensor'),
        (CHOICE, 'trajectory', 'kind: spline is not known', 'trajectory'),
        (RUN_KEY, '/**', 'unknown key burst_limit', ''),
    ],
)
def test_what_is_not_known_is_taken_as_recorded_and_the_rest_verified(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    edit: tuple[str, str], section: str, said: str, left: str,
) -> None:  # fmt: skip
    (tmp_path / 'evil_law.py').write_text('raise SystemExit("imported")')
    monkeypatch.syspath_prepend(tmp_path)
    bag = write_as_another_version(monkeypatch, tmp_path / 'bag', edit)
    assert main(['verify', str(bag)]) == 0
    out = capsys.readouterr().out
    assert f'note: {section}: taken as recorded, not known to this version: {said}\n' in out
    assert f'closed loop not computed: {section} unknown here' in out
    verdict = verify(bag)
    assert set(verdict.compared) == {*recorded_roles(RunConfig())} - {left}
    assert verdict.ticks == 300
    assert 'evil_law' not in sys.modules


def test_the_rest_of_a_run_that_is_not_known_in_full_is_judged(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def alter(tick: int, topic: int, data: bytes) -> bytes:
        return changed(topic, 1, data) if (tick, topic) == (100, STATE) else data

    bag = write_as_another_version(monkeypatch, tmp_path / 'bag', LAW, alter=alter)
    assert set(verify(bag).first) >= {'plant'}


def test_a_bad_value_is_no_sign_of_another_version(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    edit = ('    location: 9.0\n', '    location: -9.0\n')
    for edits in ([edit], [edit, LAW]):
        bag = write_as_another_version(monkeypatch, tmp_path / f'bag{len(edits)}', *edits)
        with pytest.raises(BagContentError, match=r'tip_sensor.location: -9'):
            verify(bag)


@pytest.mark.parametrize('edit', [LAW, SECTION, KEY, CHOICE])
def test_other_commands_take_a_bag_that_is_not_known_in_full(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    edit: tuple[str, str],
) -> None:  # fmt: skip
    bag = str(write_as_another_version(monkeypatch, tmp_path / 'bag', edit))
    plain = str(write_messages(tmp_path / 'plain', CONFIG))
    assert main(['compare', bag, plain]) == 0
    assert main(['export', bag, '--out', str(tmp_path / 'csv')]) == 0
    assert edit[1].strip() in (tmp_path / 'csv' / 'scenario.yaml').read_text('utf-8')
    assert main(['report', bag, '--no-pictures', '--out', str(tmp_path / 'page')]) == 0
    assert main(['recover', bag, '--out', str(tmp_path / 'new')]) == 0
    assert 'complete: 1800 messages, all topics as recorded' in capsys.readouterr().out
    assert BagReader(tmp_path / 'new').unknown == BagReader(bag).unknown != {}
    assert main(['digest', bag]) == main(['digest', str(tmp_path / 'new')]) == 0
    first, second = capsys.readouterr().out.split()
    assert first == second
    assert main(['verify', str(tmp_path / 'new')]) == 0
