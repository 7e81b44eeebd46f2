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

"""Bags of other recorders are read, compared, proved, reported and exported as our own."""

from __future__ import annotations

from collections.abc import Sequence
import csv
from dataclasses import asdict
import json
from pathlib import Path
import random
import shutil
from typing import Literal

from bagtools import small_config, small_messages, write_small
from flexarm_ros import scenario
from flexarm_ros.analysis.report.runs import load_run
from flexarm_ros.bag.checks.verify import verify
from flexarm_ros.bag.errors import BagContentError, BagError
from flexarm_ros.bag.reading.reader import BagReader
from flexarm_ros.cli import main
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.wire import parameter_event as changes
from flexarm_ros.wire.topics import (
    COMMAND,
    JOINT_STATES,
    per_tick_topics,
    REFERENCE,
    STATE,
    TIP,
    topics_of,
)
from mcap.writer import CompressionType
import numpy as np
import pytest
from repository import ROOT
from rosbag2tools import Keep, metadata, Received, received, write_mcap, write_rosbag2, write_split
from rosbags.rosbag2 import Reader, StoragePlugin
import yaml

CONFIG = small_config('encoder.latency=0.0005', 'tip_sensor.latency=0.0015', duration=0.2)
TICKS = 200
TRUTH = small_messages(CONFIG)


def all_of(config: RunConfig = CONFIG) -> list[Received]:
    return list(received(config))


def read(path: Path, config: RunConfig | None = None) -> dict[int, tuple[bytes | None, ...]]:
    return {tick: tuple(messages) for tick, messages in BagReader(path, config).ticks()}


def expected(keep: Keep = lambda tick, topic: True) -> dict[int, tuple[bytes | None, ...]]:
    return {
        tick: tuple(data if keep(tick, topic) else None for topic, data in enumerate(messages))
        for tick, messages in enumerate(TRUTH)
    }


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """Return our own bag of the same run."""
    write_small(tmp_path / 'own' / 'bag', CONFIG)
    return tmp_path / 'own'


@pytest.fixture
def scenario_file(tmp_path: Path) -> str:
    path = tmp_path / 'mine.yaml'
    path.write_text(scenario.dump(CONFIG))
    return str(path)


def storages(directory: Path, messages: Sequence[Received]) -> dict[str, Path]:
    """Write the same messages in every way that is read."""
    ways = {
        'zstd': write_mcap(directory / 'zstd' / 'zstd_0.mcap', messages),
        'lz4': write_mcap(directory / 'a.mcap', messages, compression=CompressionType.LZ4),
        'none': write_mcap(directory / 'b.mcap', messages, compression=CompressionType.NONE),
        'no summary': write_mcap(directory / 'c.mcap', messages, summary=False),
        'fastwrite': write_mcap(directory / 'd.mcap', messages, chunked=False),
        'bare': write_mcap(directory / 'e.mcap', messages, chunked=False, summary=False),
        'split': write_split(directory / 'split', messages, 11),
    }
    versions: tuple[Literal[8, 9], ...] = (8, 9)
    for version in versions:
        for plugin in StoragePlugin:
            name = f'{plugin.name.lower()} version {version}'
            ways[name] = write_rosbag2(directory / name, messages, plugin, version)
    return ways


@pytest.mark.parametrize('known', [True, False])
def test_every_storage_gives_the_ticks(known: bool, tmp_path: Path) -> None:
    for name, path in storages(tmp_path, all_of()).items():
        reader = BagReader(path, CONFIG if known else None)
        assert {tick: tuple(found) for tick, found in reader.ticks()} == expected(), name
        assert reader.damage is None, name
        assert reader.timeline.period_ns == 10**6
        assert reader.notes == ['other topics are left out: /chatter']
        assert reader.gaps == []
        assert reader.has_scenario == known


@pytest.mark.parametrize('version', range(5, 10))
def test_metadata_of_every_version(version: int, tmp_path: Path) -> None:
    write_mcap(tmp_path / 'x_0.mcap', all_of())
    metadata(tmp_path, all_of(), ['x_0.mcap'], version)
    assert verify(tmp_path, given=CONFIG).faults == []
    text = (tmp_path / 'metadata.yaml').read_text()
    (tmp_path / 'metadata.yaml').write_text(
        text.replace('message_count: 200\n', 'message_count: 7\n', 1)
    )
    assert len(verify(tmp_path, given=CONFIG).faults) == 1


def test_any_order(tmp_path: Path) -> None:
    messages = all_of()
    random.Random(5).shuffle(messages)
    assert read(write_mcap(tmp_path / 'x.mcap', messages), CONFIG) == expected()


def test_ten_files_are_in_order_of_their_numbers(tmp_path: Path) -> None:
    path = write_split(tmp_path / 'split', all_of(), 11)
    ticks = [tick for tick, _, _ in BagReader(path, CONFIG).messages()]
    assert max(b - a for a, b in zip(ticks[1:], ticks, strict=False)) <= 32
    (path / 'metadata.yaml').unlink()
    assert read(path) == expected()


GENTLE = ('controller.kp=20', 'controller.kd=2', 'controller.ks=2')


@pytest.mark.parametrize(
    'overrides',
    [
        ('tip_sensor.rate=100', 'tip_sensor.latency=0.0043', 'controller.feedback=encoder'),
        ('tip_sensor.latency=0', 'encoder.latency=0.02'),
        (
            'tip_sensor.jitter=0.004',
            'tip_sensor.dropout=0.2',
            'encoder.rate=250',
            'controller.kp=9',
            'controller.kd=9',
        ),
        ('tip_sensor.more_locations=[5.0, 7.0]', 'plant.modes=2'),
        ('control_period=0.002', 'controller.law=pd'),
    ],
)
@pytest.mark.parametrize('known', [True, False])
def test_sensors_of_every_kind(overrides: tuple[str, ...], known: bool, tmp_path: Path) -> None:
    """Held samples, long latencies, further sensors, another period: with a scenario or none."""
    config = small_config(*overrides, duration=0.2)
    path = write_mcap(tmp_path / 'x.mcap', all_of(config))
    found = read(path, config if known else None)
    assert found == dict(enumerate(small_messages(config)))
    verdict = verify(path, given=config)
    assert verdict.same and verdict.ticks == verdict.planned


def lossy(seed: int, topics: Sequence[int], share: float = 0.3) -> Keep:
    generator = random.Random(seed)
    lost = {(k, t) for k in range(5, TICKS - 5) for t in topics if generator.random() < share}
    return lambda tick, topic: (tick, topic) not in lost


@pytest.mark.parametrize('topic', range(6))
def test_lost_messages_are_missing_and_none_is_mismatched(topic: int, tmp_path: Path) -> None:
    keep = lossy(topic, [topic])
    path = write_mcap(tmp_path / 'x.mcap', list(received(CONFIG, keep)))
    for config in (CONFIG, None):
        assert read(path, config) == expected(keep)
        name = per_tick_topics(CONFIG)[topic].path
        (gap,) = BagReader(path, config).gaps
        missing = sum(not keep(k, topic) for k in range(TICKS))
        first = next(k for k in range(TICKS) if not keep(k, topic))
        assert gap == f'{name}: {missing} of 200 messages are missing, the first at tick {first}'
    verdict = verify(path, given=CONFIG)
    assert not verdict.first
    assert len(verdict.faults) == 1
    assert verdict.faults[0].endswith(f'no message on {name}')


def test_held_samples_of_which_some_are_lost(tmp_path: Path) -> None:
    """Which of equal messages is lost cannot be told; that it is one of them can."""
    config = small_config('tip_sensor.rate=100', 'controller.feedback=encoder', duration=0.2)
    path = write_mcap(
        tmp_path / 'x.mcap', list(received(config, lambda k, t: (k, t) != (57, TIP)))
    )
    missing = [k for k, messages in read(path, config).items() if messages[TIP] is None]
    assert missing == [59]
    verdict = verify(path, given=config)
    assert not verdict.first
    assert verdict.faults == ['tick 59: no message on /tip_sensor/odometry']
    reader = BagReader(path)
    assert list(reader.names) and '--scenario FILE may determine them' in reader.notes[-1]


@pytest.mark.parametrize('first', [1, 57])
def test_recording_that_began_late(first: int, tmp_path: Path) -> None:
    """Each topic begins when its subscription was there."""
    starts = {t: first + t for t in range(6)}
    path = write_mcap(tmp_path / 'x.mcap', list(received(CONFIG, lambda k, t: k >= starts[t])))
    truth = expected(lambda k, t: k >= starts[t])
    assert read(path, CONFIG) == {k: v for k, v in truth.items() if k >= first}
    verdict = verify(path, given=CONFIG)
    assert not verdict.first
    assert any(note.startswith(('ticks 0', 'tick 0')) for note in verdict.notes)
    reader = BagReader(
        path
    )  # without a scenario: no mismatch, but what cannot be told is left out
    assert any('/joint_states is left out' in note for note in reader.notes)
    assert all(messages[JOINT_STATES] is None for _, messages in reader.ticks())
    assert f'starts at tick {first}' in reader.gaps


def test_late_with_all_topics_at_once(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / 'x.mcap', list(received(CONFIG, lambda k, t: k >= 57)))
    assert read(path) == {k: v for k, v in expected().items() if k >= 57}
    verdict = verify(path, given=CONFIG)
    assert verdict.same
    assert verdict.compared['closed loop'] == 6 * 143


def test_a_namespace(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / 'x.mcap', list(received(CONFIG, namespace='/arm1')))
    assert read(path) == expected()
    assert verify(path, given=CONFIG).same
    other = small_config('controller.law=pd', duration=0.2)
    two = [
        *received(CONFIG, namespace='/left'),
        *received(other, namespace='/right', others=False),
    ]
    path = write_mcap(tmp_path / 'y.mcap', sorted(two, key=lambda m: m.time))
    with pytest.raises(BagContentError, match=r'several namespaces, choose one: /left, /right'):
        BagReader(path)
    assert verify(path, given=CONFIG, namespace='left').same
    assert verify(path, given=other, namespace='/right').same
    with pytest.raises(BagContentError, match=r'no run in namespace /up; there is /left, /right'):
        BagReader(path, namespace='up')


def test_two_runs_in_one_bag(tmp_path: Path) -> None:
    other = small_config('controller.law=pd', duration=0.2)
    path = write_mcap(tmp_path / 'x.mcap', [*all_of(), *all_of(other)])
    with pytest.raises(BagContentError, match='has two messages .two runs in one bag'):
        list(BagReader(path).ticks())
    path = write_mcap(tmp_path / 'y.mcap', [*all_of(), *all_of()])  # the same twice is once
    assert read(path, CONFIG) == expected()


def test_a_wrong_scenario(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / 'x.mcap', all_of())
    with pytest.raises(BagContentError, match='100 of 200 messages at no tick of the run'):
        verify(path, given=small_config('control_period=0.002'))
    verdict = verify(path, given=small_config('encoder.latency=0.0007', duration=0.2))
    assert verdict.first['encoder'].field == 'stamp'
    assert set(verdict.first) >= {'encoder', 'closed loop'}


def test_one_bit(tmp_path: Path) -> None:
    topics = per_tick_topics(CONFIG)
    messages = all_of()
    place = [i for i, m in enumerate(messages) if m.topic == '/joint_command'][137]
    stamp, values = topics[COMMAND].codec.decode(messages[place].data)
    numbers = np.array(values)
    numbers.view(np.int64)[1] ^= 1
    messages[place] = messages[place]._replace(data=topics[COMMAND].codec.encode(stamp, *numbers))
    verdict = verify(write_mcap(tmp_path / 'x.mcap', messages), given=CONFIG)
    assert verdict.earliest is not None
    assert (verdict.earliest.tick, verdict.earliest.field) == (137, 'effort.elbow')


def test_padding_of_a_middleware_is_no_difference(tmp_path: Path) -> None:
    messages = [
        m._replace(data=m.data + bytes(4)) if m.topic != '/chatter' else m for m in all_of()
    ]
    verdict = verify(write_mcap(tmp_path / 'x.mcap', messages), given=CONFIG)
    assert verdict.same


def test_a_bag_of_some_topics(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    some = lambda k, t: t in (STATE, TIP)  # noqa: E731
    path = write_mcap(tmp_path / 'x.mcap', list(received(CONFIG, some)))
    assert read(path) == expected(some)
    verdict = verify(path, given=CONFIG)
    assert not verdict.first
    assert 'no topic /joint_command in the bag' in verdict.faults
    assert main(['export', str(path), '--out', str(tmp_path / 'tables')]) == 0
    assert {p.name for p in (tmp_path / 'tables').iterdir()} == {
        'plant_state.csv', 'tip_sensor_odometry.csv',
    }  # fmt: skip
    assert 'note: no topic /clock, ' in capsys.readouterr().out


# --- the commands -----------------------------------------------------------------------


def test_verify_needs_a_scenario(
    tmp_path: Path, scenario_file: str, own: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = str(write_mcap(tmp_path / 'x.mcap', all_of()))
    assert main(['verify', path]) == 1
    said = capsys.readouterr()
    assert said.err.count('\n') == 1
    assert 'no scenario in it' in said.err and '--scenario FILE' in said.err
    assert main(['verify', path, '--scenario', scenario_file]) == 0
    out = capsys.readouterr().out
    assert '200 of 200 ticks compared' in out
    assert 'does not contain the versions' in out
    assert out.endswith('the same\n')
    words = [f'--set={text}' for text in (
        'duration=0.2', 'encoder.latency=0.0005', 'tip_sensor.latency=0.0015')]  # fmt: skip
    assert main(['verify', path, '--scenario', 'fls_tip', *words]) == 0
    assert main(['verify', path, *words]) == 2
    assert '--set: needs --scenario' in capsys.readouterr().err
    assert main(['verify', path, '--scenario', str(tmp_path / 'none.yaml')]) == 2
    assert main(['verify', str(own), '--scenario', scenario_file]) == 1
    assert 'has a scenario of its own' in capsys.readouterr().err


def rows_of(path: Path) -> list[list[str]]:
    with open(path, newline='') as file:
        return list(csv.reader(file))


def test_export(
    tmp_path: Path, scenario_file: str, own: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The tables are those of our own bag of the run."""
    path = str(write_mcap(tmp_path / 'x.mcap', all_of(), chunked=False))
    assert main(['export', str(own), '--out', str(tmp_path / 'a')]) == 0
    assert main(['export', path, '--scenario', scenario_file, '--out', str(tmp_path / 'b')]) == 0
    names = sorted(file.name for file in (tmp_path / 'a').iterdir())
    assert names == sorted(file.name for file in (tmp_path / 'b').iterdir())
    for name in names:
        assert (tmp_path / 'a' / name).read_bytes() == (tmp_path / 'b' / name).read_bytes(), name
    capsys.readouterr()
    assert main(['export', path, '--out', str(tmp_path / 'c')]) == 0
    out = capsys.readouterr().out
    assert 'note: no scenario: no trajectory and no scenario.yaml' in out
    assert sorted(p.name for p in (tmp_path / 'c').iterdir()) == [
        name for name in names if name not in ('scenario.yaml', 'trajectory.csv')
    ]
    for file in (tmp_path / 'c').iterdir():
        assert file.read_bytes() == (tmp_path / 'a' / file.name).read_bytes()


def test_trajectory_of_a_lossy_bag(tmp_path: Path, scenario_file: str) -> None:
    keep = lossy(1, [COMMAND, TIP])
    path = str(write_mcap(tmp_path / 'x.mcap', list(received(CONFIG, keep))))
    assert main(['export', path, '--scenario', scenario_file, '--out', str(tmp_path / 'b')]) == 0
    header, *rows = rows_of(tmp_path / 'b' / 'trajectory.csv')
    assert len(rows) == 200
    for tick, row in enumerate(rows):
        assert (row[header.index('tau1')] == 'nan') == (not keep(tick, COMMAND))
        assert (row[header.index('meas_x')] == 'nan') == (not keep(tick, TIP))
        assert row[header.index('tip_x')] != 'nan'


def test_our_own_bag_with_a_gap(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The trajectory ends at the gap, and both that show it say so."""
    from flexarm_ros.bag.writer import BagWriter

    with BagWriter(tmp_path / 'gap', CONFIG) as writer:
        for tick in (*range(100), *range(120, TICKS)):
            for topic, data in enumerate(TRUTH[tick]):
                writer.write(topic, tick, data)
            writer.end_tick(tick)
    assert main(['export', str(tmp_path / 'gap'), '--out', str(tmp_path / 'tables')]) == 0
    assert 'note: trajectory: only the first 100 of 200 ticks' in capsys.readouterr().out
    run = load_run(tmp_path / 'gap')
    assert run.summary['problem'] == 'only the first 100 of 200 ticks are complete'


def test_compare(tmp_path: Path, own: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(write_mcap(tmp_path / 'x.mcap', all_of()))
    assert main(['compare', str(own), path]) == 0
    out = capsys.readouterr().out
    assert 'all within tolerance' in out
    assert 'note: B: other topics are left out: /chatter' in out
    lossy_path = str(write_mcap(
        tmp_path / 'y.mcap', list(received(CONFIG, lossy(3, [REFERENCE])))
    ))  # fmt: skip
    assert main(['compare', path, lossy_path, '--json']) == 1
    data = json.loads(capsys.readouterr().out)
    assert data['only_a']['/reference'] > 30
    assert not any(field['beyond'] for field in data['fields'])
    apart = str(write_mcap(tmp_path / 'z.mcap', list(received(CONFIG, lambda k, t: k >= 100))))
    early = str(write_mcap(tmp_path / 'e.mcap', list(received(CONFIG, lambda k, t: k < 100))))
    assert main(['compare', apart, early]) == 1
    assert 'NOTHING compared' in capsys.readouterr().out


def test_compare_runs_with_other_topics(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A run with further sensors against one without: their messages have no counterpart."""
    write_small(tmp_path / 'a', small_config(duration=0.05))
    write_small(tmp_path / 'b', small_config('tip_sensor.more_locations=[5.0]', duration=0.05))
    assert main(['compare', str(tmp_path / 'a'), str(tmp_path / 'b')]) == 1
    assert '/tip_sensor/odometry_1: 50 messages only in B' in capsys.readouterr().out
    assert main(['compare', str(tmp_path / 'b'), str(tmp_path / 'a')]) == 1
    assert '/tip_sensor/odometry_1: 50 messages only in A' in capsys.readouterr().out


def test_report(
    tmp_path: Path, scenario_file: str, own: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_mcap(tmp_path / 'rec' / 'rec_0.mcap', all_of(), summary=False)
    mine, whole = load_run(path, CONFIG), load_run(own)
    for name, column in whole.columns.items():
        assert np.array_equal(column, mine.columns[name]), name
    assert mine.summary['max_error'] == whole.summary['max_error']
    bare = load_run(path)
    assert bare.rows == 200
    for name in ('theta1', 'delta2', 'meas_x', 'tau2', 't'):
        assert np.array_equal(bare.columns[name], whole.columns[name])
    assert np.isnan(bare.columns['tip_x']).all()
    assert 'no scenario' in bare.summary['problem']
    for words in ([], ['--scenario', scenario_file, '--no-pictures']):
        assert main(['report', str(path.parent), '--out', str(tmp_path / 'page'), *words]) == 0
    assert (tmp_path / 'page' / 'report.html').stat().st_size > 20_000
    assert 'error' not in capsys.readouterr().err


# --- nothing is no success --------------------------------------------------------------


def test_a_bag_without_a_message_of_a_run(
    tmp_path: Path, scenario_file: str, capsys: pytest.CaptureFixture[str]
) -> None:
    from flexarm_ros.bag.writer import BagWriter

    chatter = [message for message in all_of() if message.topic == '/chatter']
    with BagWriter(tmp_path / 'none', CONFIG):
        pass
    for path in (write_mcap(tmp_path / 'x.mcap', chatter, chunked=False), tmp_path / 'none'):
        for words in (
            ['export', str(path), '--out', str(tmp_path / 'out')],
            ['compare', str(path), str(path)],
            ['report', str(path), '--out', str(tmp_path / 'out')],
            ['verify', str(path)],
        ):
            assert main(words) in (1, 2), words
            said = capsys.readouterr()
            assert 'no topic of a run in it' in said.err or (
                'no message' in said.err + said.out
            ), words
            assert 'Traceback' not in said.err and 'internal error' not in said.err
            assert not (tmp_path / 'out').exists()


def test_unchunked_is_recovered_as_far_as_it_goes(tmp_path: Path) -> None:
    from flexarm_ros.bag.mcap.recover import recover

    path = write_mcap(tmp_path / 'x.mcap', all_of(), chunked=False)
    rescue = recover(path, tmp_path / 'new')
    assert rescue.kept == len(all_of())
    assert read(tmp_path / 'new') == expected()
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(path.read_bytes()[:200_000])
    rescue = recover(cut, tmp_path / 'part')
    assert rescue.status == 3
    assert 0 < rescue.kept < len(all_of())
    assert verify(tmp_path / 'part', given=CONFIG).first == {}
    verdict = verify(cut, given=CONFIG)
    assert any('a truncated record' in note for note in verdict.faults)


def test_our_own_run_rewritten_without_chunks(own: Path, tmp_path: Path) -> None:
    from mcap.reader import make_reader
    from mcap.writer import Writer

    with open(own / 'bag' / 'bag_0.mcap', 'rb') as source, open(tmp_path / 'x.mcap', 'wb') as file:
        reader, writer = make_reader(source), Writer(file, use_chunking=False)
        writer.start('ros2')
        for attachment in reader.iter_attachments():
            writer.add_attachment(0, 0, attachment.name, attachment.media_type, attachment.data)
        ids: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            assert schema is not None
            if channel.id not in ids:
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.id] = writer.register_channel(channel.topic, 'cdr', kind)
            writer.add_message(ids[channel.id], message.log_time, message.data, 0)
        writer.finish()
    verdict = verify(tmp_path / 'x.mcap')
    assert verdict.same and verdict.ticks == TICKS


# --- what is refused --------------------------------------------------------------------


def test_compressed_files_are_refused(tmp_path: Path) -> None:
    import zstandard

    path = write_mcap(tmp_path / 'rec' / 'rec_0.mcap', all_of())
    packed = path.with_name('rec_0.mcap.zstd')
    packed.write_bytes(zstandard.compress(path.read_bytes()))
    path.unlink()
    for run in (packed, packed.parent):
        with pytest.raises(BagError, match=r'compressed as a whole; decompress it: zstd -d'):
            BagReader(run)
    single = [m._replace(data=zstandard.compress(m.data)) for m in all_of()]
    with pytest.raises(BagContentError, match='no CDR; if messages were compressed one by one'):
        BagReader(write_mcap(tmp_path / 'x.mcap', single))


def test_hostile_sqlite(tmp_path: Path) -> None:
    good = write_rosbag2(tmp_path / 'good', all_of(), StoragePlugin.SQLITE3, 9)
    (file,) = good.glob('*.db3')
    sound = file.read_bytes()
    generator = random.Random(4)
    for content in (b'', b'text', bytes(5000), sound[:5000], sound[: len(sound) // 2]):
        file.write_bytes(content)
        with pytest.raises(BagError) as caught:
            list(BagReader(file, CONFIG).ticks())
        assert '\n' not in str(caught.value)
    for _ in range(15):
        data = bytearray(sound)
        for _ in range(50):
            data[generator.randrange(len(data))] = generator.randrange(256)
        file.write_bytes(bytes(data))
        try:
            list(BagReader(file, CONFIG).ticks())
        except BagError as error:
            assert '\n' not in str(error)


def test_files_of_two_bags(tmp_path: Path) -> None:
    path = write_split(tmp_path / 'split', all_of(), 3)
    shutil.copy(path / 'split_0.mcap', path / 'stranger.mcap')
    with pytest.raises(BagError, match='metadata.yaml does not name stranger.mcap'):
        BagReader(path)
    (path / 'stranger.mcap').rename(path / 'stranger.db3')
    with pytest.raises(BagError, match='holds .mcap and .db3 files'):
        BagReader(path)
    (path / 'stranger.db3').unlink()
    (path / 'split_1.mcap').unlink()
    verdict = verify(path, given=CONFIG)
    assert 'metadata.yaml lists 3 files, 2 were read' in verdict.notes
    assert any('missing' in fault for fault in verdict.faults)


# --- there and back ---------------------------------------------------------------------


def test_rosbags_convert_there_and_back(own: Path, tmp_path: Path) -> None:
    """What `ros2 bag info` and `play` need, and a conversion to sqlite3 and back to MCAP."""
    from rosbags.convert.converter import convert

    with Reader(own / 'bag') as reader:
        assert reader.message_count == 6 * TICKS
        assert reader.ros_distro == 'kilted'
        profiles = {c.topic: c.ext.offered_qos_profiles for c in reader.connections}
        assert all(len(found) == 1 and found[0].depth == 1000 for found in profiles.values())
    common = {
        'dst_version': 9, 'compress': None, 'compress_mode': 'file', 'default_typestore': None,
        'typestore': None, 'exclude_topics': (), 'include_topics': (), 'exclude_msgtypes': (),
        'include_msgtypes': (),
    }  # fmt: skip
    convert([own / 'bag'], tmp_path / 'sqlite', dst_storage='sqlite3', **common)
    convert([tmp_path / 'sqlite'], tmp_path / 'back', dst_storage='mcap', **common)
    for name in ('sqlite', 'back'):
        assert read(tmp_path / name, CONFIG) == expected()
        verdict = verify(tmp_path / name, given=CONFIG)
        assert verdict.same and verdict.ticks == TICKS


def test_qos_overrides_for_the_recorder() -> None:
    """The shipped file names each topic with its own quality of service, in rosbag2's words."""
    found = yaml.safe_load((ROOT / 'config' / 'rosbag2' / 'qos_overrides.yaml').read_text())
    qos = {topic.path: topic.qos for topic in topics_of(1, 4)}
    assert found == {
        name: asdict(held) for name, held in {**qos, changes.PATH: changes.QOS}.items()
    }
    pytest.importorskip('rclpy')
    from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSReliabilityPolicy

    for held in found.values():
        assert QoSHistoryPolicy.get_from_short_key(held['history'])
        assert QoSReliabilityPolicy.get_from_short_key(held['reliability'])
        assert QoSDurabilityPolicy.get_from_short_key(held['durability'])
