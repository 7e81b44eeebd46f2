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

"""Rescue of damaged bags: truncation at any byte, flipped bits, overwritten places."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import io
import json
import os
from pathlib import Path
import random
import resource
import struct
import subprocess
import sys

from bagtools import small_config, small_messages, write_small
from flexarm_ros.bag.errors import BagError, BagExistsError
from flexarm_ros.bag.mcap.recover import recover, Rescue
from flexarm_ros.bag.mcap.scan import Scanner
from flexarm_ros.bag.reading.reader import BagReader
from flexarm_ros.bag.recording import finish_run, prepare_directory
from flexarm_ros.cli import main
from mcap.reader import make_reader
from mcap.writer import Writer
import pytest
from repository import PATH
from rosbag2tools import Received, text, write_mcap

CONFIG = small_config()
TICKS, CHUNK = 300, 50


@pytest.fixture(scope='module')
def sound(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return write_small(tmp_path_factory.mktemp('sound') / 'bag', CONFIG).read_bytes()


@pytest.fixture(scope='module')
def chunk_ends(sound: bytes, tmp_path_factory: pytest.TempPathFactory) -> list[int]:
    path = tmp_path_factory.mktemp('ends') / 'x.mcap'
    path.write_bytes(sound)
    with Scanner(path) as scanner:
        return [record.end for record in scanner.records() if record.opcode == 0x06]


def rescue_bytes(data: bytes, tmp_path: Path, name: str = 'new') -> tuple[Rescue, Path]:
    source = tmp_path / f'{name}.mcap'
    source.write_bytes(data)
    target = tmp_path / name
    rescue = recover(source, target)
    assert target.exists() == (rescue.kept > 0)
    return rescue, target


def is_chunk_start(data: bytes, start: int, end: int) -> bool:
    opcode, length = struct.unpack_from('<BQ', data, start)
    return opcode == 0x06 and length == end - start - 9


def check_content(bag: Path, expected_ticks: set[int] | None = None) -> set[int]:
    """Everything in a rescued bag is as it was recorded."""
    reader = BagReader(bag)
    truth = small_messages(CONFIG)
    found = set()
    for tick, messages in reader.ticks():
        assert tuple(messages) == truth[tick]
        found.add(tick)
    assert reader.damage is None
    assert reader.config.controller == CONFIG.controller
    if expected_ticks is not None:
        assert found == expected_ticks
    return found


def test_whole_bag_gives_the_same_bytes(sound: bytes, tmp_path: Path) -> None:
    rescue, bag = rescue_bytes(sound, tmp_path)
    assert rescue.status == 0
    assert rescue.damages == []
    assert (bag / 'bag_0.mcap').read_bytes() == sound


def test_truncation_at_many_offsets(sound: bytes, chunk_ends: list[int], tmp_path: Path) -> None:
    """Every chunk that is there in full is rescued, whatever byte the file ends at."""
    assert len(chunk_ends) == TICKS // CHUNK
    edges = {end + d for end in chunk_ends for d in (-1, 0, 1)}
    random_places = random.Random(1).sample(range(len(sound)), 30)
    for cut in sorted({0, 1, 8, 9, *edges, *random_places, len(sound) - 1}):
        rescue, bag = rescue_bytes(sound[:cut], tmp_path, f'cut{cut}')
        chunks = sum(end <= cut for end in chunk_ends)
        assert rescue.complete == chunks * CHUNK, cut
        assert rescue.status == (0 if chunks == len(chunk_ends) else 3 if chunks else 1), cut
        if chunks:
            check_content(bag, set(range(chunks * CHUNK)))


def test_a_rescue_says_how_far_it_is(sound: bytes, chunk_ends: list[int], tmp_path: Path) -> None:
    (tmp_path / 'x.mcap').write_bytes(sound[: chunk_ends[-1]])
    shares: list[float] = []
    recover(tmp_path / 'x.mcap', tmp_path / 'new', shares.append)
    assert shares == sorted(shares)
    assert shares[0] < 0.1 and 0.5 in shares and shares[-1] == 1.0
    assert len(shares) >= 2 * len(chunk_ends)


def test_the_mending_of_a_run_says_how_far_it_is(
    sound: bytes, chunk_ends: list[int], tmp_path: Path
) -> None:
    prepare_directory(tmp_path / 'run', CONFIG, 'small')
    (tmp_path / 'run' / 'bag').mkdir()
    (tmp_path / 'run' / 'bag' / 'bag_0.mcap').write_bytes(sound[: chunk_ends[1]])
    told: list[tuple[str, float]] = []
    summary = finish_run(
        tmp_path / 'run', CONFIG, 'small', work=lambda text, share: told.append((text, share))
    )
    assert summary['ticks'] == 2 * CHUNK
    assert {text for text, _ in told} == {'repairing the bag, which the recorder did not finish'}
    assert told[0][1] == 0.0 and told[-1][1] == 1.0
    finish_run(tmp_path / 'run', CONFIG, 'small', work=lambda *_: pytest.fail('mended twice'))


def test_flipped_bytes(sound: bytes, chunk_ends: list[int], tmp_path: Path) -> None:
    """A damaged byte costs at most the chunk it is in, and never gives wrong messages."""
    generator = random.Random(2)
    places = generator.sample(range(len(sound)), 60) + list(range(8, 60, 2))
    for place in places:
        damaged = bytearray(sound)
        damaged[place] ^= 1 << generator.randrange(8)
        rescue, bag = rescue_bytes(bytes(damaged), tmp_path, f'flip{place}')
        assert rescue.complete >= TICKS - CHUNK, place
        found = check_content(bag)
        assert len(found) == rescue.complete
        whole = len(found) == TICKS and not rescue.lost_front
        assert rescue.status == (0 if whole else 3), place


@pytest.mark.parametrize('fill', [b'\x00', b'\xff'])
def test_overwritten_sectors(sound: bytes, fill: bytes, tmp_path: Path) -> None:
    """As after a power cut: 512 bytes in a row are not what was written."""
    for start in range(0, len(sound) - 512, 4096):
        end = start + 512
        damaged = sound[:start] + fill * 512 + sound[end:]
        rescue, bag = rescue_bytes(damaged, tmp_path, f'sector{start}')
        assert rescue.kept > 0
        if rescue.planned:
            assert rescue.complete >= TICKS - 2 * CHUNK
            check_content(bag)


def test_front_lost(sound: bytes, chunk_ends: list[int], tmp_path: Path) -> None:
    """Without any scenario the messages are rescued under the channels of the index."""
    front = next(i for i in range(chunk_ends[0]) if is_chunk_start(sound, i, chunk_ends[0]))
    rescue, bag = rescue_bytes(bytes(front) + sound[front:], tmp_path)
    assert rescue.status == 3
    assert rescue.planned == 0
    assert rescue.kept == 6 * TICKS
    from rosbags.highlevel import AnyReader

    with AnyReader([bag]) as reader:
        assert reader.message_count == 6 * TICKS
    with pytest.raises(BagError, match='no scenario'):
        _ = BagReader(bag).config


def test_scenario_restored_from_its_copy(sound: bytes, tmp_path: Path) -> None:
    assert b'kp: 150.79' in sound
    damaged = sound.replace(b'kp: 150.79', b'kp: 150.78', 1)
    rescue, bag = rescue_bytes(damaged, tmp_path)
    assert rescue.status == 0
    assert any('copy' in text for text in rescue.damages)
    check_content(bag, set(range(TICKS)))


def test_both_scenarios_altered_are_not_believed(sound: bytes, tmp_path: Path) -> None:
    damaged = sound.replace(b'kp: 150.79', b'kp: 150.78').replace(b'150.79', b'150.77')
    rescue, _ = rescue_bytes(damaged, tmp_path)
    assert rescue.status == 3
    assert rescue.lost_front


def test_not_a_bag(tmp_path: Path) -> None:
    rescue, bag = rescue_bytes(random.Random(3).randbytes(20000), tmp_path)
    assert rescue.status == 1
    assert not bag.exists()


def test_recorder_killed(tmp_path: Path) -> None:
    """SIGKILL in the middle: everything up to the last chunk that was due is rescued."""
    code = (
        'import sys\n'
        'from pathlib import Path\n'
        'from bagtools import *\n'
        'config = small_config()\n'
        'writer = BagWriter(Path(sys.argv[1]), config)\n'
        'for tick, messages in enumerate(small_messages(config)):\n'
        '    for topic, data in enumerate(messages):\n'
        '        writer.write(topic, tick, data)\n'
        '    if tick >= int(sys.argv[2]):\n'
        '        print(tick, flush=True)\n'
        '        sys.stdin.readline()\n'
    )
    environment = {**os.environ, 'PYTHONPATH': PATH}
    for last in (48, 49, 120, 275):
        bag = tmp_path / f'bag{last}'
        process = subprocess.Popen(
            [sys.executable, '-c', code, str(bag), str(last)], env=environment,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip
        with process:
            assert process.stdout is not None
            assert int(process.stdout.readline()) == last
            process.kill()
        rescue = recover(bag, tmp_path / f'new{last}')
        chunks = (last + 1) // CHUNK
        assert rescue.complete == chunks * CHUNK
        assert rescue.status == (3 if chunks else 1)
        if chunks:
            check_content(tmp_path / f'new{last}', set(range(chunks * CHUNK)))


def test_never_overwrites(sound: bytes, tmp_path: Path) -> None:
    (tmp_path / 'there').mkdir()
    (tmp_path / 'a.mcap').write_bytes(sound)
    with pytest.raises(BagExistsError):
        recover(tmp_path / 'a.mcap', tmp_path / 'there')
    (tmp_path / 'link').symlink_to(tmp_path / 'nowhere')
    with pytest.raises(BagExistsError):
        recover(tmp_path / 'a.mcap', tmp_path / 'link')


def test_command(
    sound: bytes, chunk_ends: list[int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def call(data: bytes, name: str) -> tuple[int, str, str]:
        source = tmp_path / f'{name}.mcap'
        source.write_bytes(data)
        status = main(['recover', str(source), '--out', str(tmp_path / name)])
        said = capsys.readouterr()
        return status, said.out, said.err

    status, out, _ = call(sound, 'whole')
    assert status == 0
    assert out.startswith('complete: 1800 messages, 300 of 300 ticks')
    status, out, _ = call(sound[: chunk_ends[3]], 'part')
    assert status == 3
    assert out.startswith('in part: 1200 messages, 200 of 300 ticks')
    assert 'is truncated' in out
    status, _, err = call(sound[:100], 'none')
    assert status == 1
    assert err.startswith('nothing: ')
    status, _, err = call(sound, 'whole')
    assert status == 2
    assert 'not overwritten' in err
    assert main(['recover', str(tmp_path / 'absent'), '--out', str(tmp_path / 'y')]) == 2
    assert 'no such file' in capsys.readouterr().err


def rewritten(
    sound: bytes, path: Path, alter: Callable[[str, int, bytes], list[tuple[str, int, bytes]]]
) -> Path:
    """Write our bag anew with other messages, its scenario and provenance as they were."""
    with open(path, 'wb') as file:
        writer, reader = Writer(file, chunk_size=20_000), make_reader(io.BytesIO(sound))
        writer.start('ros2', 'libmcap')
        for attachment in reader.iter_attachments():
            writer.add_attachment(
                attachment.create_time, attachment.log_time, attachment.name,
                attachment.media_type, attachment.data,
            )  # fmt: skip
        for metadata in reader.iter_metadata():
            writer.add_metadata(metadata.name, metadata.metadata)
        channels: dict[str, int] = {}
        for schema, channel, message in reader.iter_messages():
            for topic, time, data in alter(channel.topic, message.log_time, message.data):
                if topic not in channels:
                    kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                    channels[topic] = writer.register_channel(topic, 'cdr', kind)
                writer.add_message(channels[topic], time, data, time)
        writer.finish()
    return path


def test_other_topics_and_second_messages_are_no_loss(
    sound: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = rewritten(
        sound,
        tmp_path / 'more.mcap',
        lambda topic, time, data: (
            [(topic, time, data)] * (1 + (topic == '/clock'))
            + [('/camera', time, data)] * (topic == '/clock')
        ),
    )
    assert main(['recover', str(path), '--out', str(tmp_path / 'new')]) == 0
    said = capsys.readouterr().out
    assert said.startswith('complete: 1800 messages, 300 of 300 ticks')
    assert 'left out: 300 messages on topics that the run does not have\n' in said
    assert 'left out: 300 second messages of a topic at a tick\n' in said
    check_content(tmp_path / 'new', set(range(TICKS)))


def test_nothing_has_a_reason_and_leaves_nothing(
    sound: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = rewritten(
        sound, tmp_path / 'late.mcap', lambda topic, time, data: [(topic, time + 1, data)]
    )
    assert main(['recover', str(path), '--out', str(tmp_path / 'new')]) == 1
    assert 'nothing: none of its messages belongs to the run' in capsys.readouterr().err
    assert not (tmp_path / 'new').exists()


def test_a_sound_bag_that_never_had_a_scenario_is_whole(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sent = [Received('/chatter', 'std_msgs/msg/String', 10**9 + i, text(str(i))) for i in range(9)]
    path = write_mcap(tmp_path / 'other.mcap', sent)
    assert main(['recover', str(path), '--out', str(tmp_path / 'new')]) == 0
    assert capsys.readouterr().out.startswith('complete: 9 messages, no scenario')
    cut = tmp_path / 'cut.mcap'
    whole = path.read_bytes()
    with Scanner(path) as scanner:
        (end,) = [record.end for record in scanner.records() if record.opcode == 0x06]
    cut.write_bytes(whole[:end])
    assert main(['recover', str(cut), '--out', str(tmp_path / 'part')]) == 3


def test_one_message_is_not_called_messages(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sent = [Received('/chatter', 'std_msgs/msg/String', 10**9, text('one'))]
    path = write_mcap(tmp_path / 'other.mcap', sent)
    assert main(['recover', str(path), '--out', str(tmp_path / 'new')]) == 0
    assert capsys.readouterr().out.startswith('complete: 1 message, no scenario')
    words = ['--set', 'duration=0.001', '--no-pictures', '--out', str(tmp_path / 'run')]
    assert main(['simulate', 'fls_tip', *words]) == 0
    capsys.readouterr()
    assert main(['verify', str(tmp_path / 'run')]) == 0
    said = capsys.readouterr().out
    assert '1 of 1 tick compared\n' in said and '  encoder      1 message the same\n' in said
    assert '1 messages' not in said


LIMIT = 120_000
"""Bytes that a file may have in the tests of a disk that fills up."""


def with_little_room(*words: str | Path) -> subprocess.CompletedProcess[str]:
    """Run a command whose files cannot grow beyond `LIMIT`: as on a full disk, mid-record."""

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (LIMIT, LIMIT))

    return subprocess.run(
        [sys.executable, '-m', 'flexarm_ros.cli', *map(str, words)], preexec_fn=limited,
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip


def written_part(run: Path) -> int:
    """Return the whole ticks that a bag cut at `LIMIT` must give back, having checked its mark."""
    summary = json.loads((run / 'summary.json').read_text())
    assert summary['complete'] is False
    assert summary['stable'] is None
    chunks = 0
    with Scanner(run / 'bag' / 'bag_0.mcap') as scanner, contextlib.suppress(BagError):
        for record in scanner.records():
            chunks += record.opcode == 0x06
    return chunks * CHUNK


def test_disk_full_under_a_simulation(tmp_path: Path) -> None:
    run = tmp_path / 'run'
    done = with_little_room('simulate', 'fls_tip', '--set', 'duration=1',
                            '--set', 'recorder.chunk_time=0.05', '--out', run)  # fmt: skip
    assert done.returncode == 1, done.stderr
    assert done.stderr.count('\n') == 1
    assert 'bag_0.mcap: cannot be written: File too large' in done.stderr
    assert (run / 'bag' / 'bag_0.mcap').stat().st_size == LIMIT
    ticks = written_part(run)
    assert ticks >= 200
    assert main(['recover', str(run), '--out', str(tmp_path / 'new')]) == 3
    assert len(list(BagReader(tmp_path / 'new').ticks())) == ticks
    assert main(['verify', str(tmp_path / 'new')]) == 0


@pytest.mark.slow
@pytest.mark.nodes
def test_disk_full_under_a_run(tmp_path: Path) -> None:
    run = tmp_path / 'run'
    done = with_little_room('run', 'fls_tip', '--set', 'duration=1', '--no-pictures',
                            '--set', 'recorder.chunk_time=0.05', '--out', run)  # fmt: skip
    assert done.returncode == 1
    assert 'recorder: tick ' in done.stderr
    assert 'cannot be written: File too large' in done.stderr
    assert 'Traceback' not in done.stderr
    assert main(['verify', str(run)]) == 0
    assert json.loads((run / 'summary.json').read_text())['complete'] is False


def test_a_rescue_that_finds_no_room_leaves_nothing(tmp_path: Path) -> None:
    assert main(['simulate', 'fls_tip', '--set', 'duration=1', '--no-pictures',
                 '--out', str(tmp_path / 'run')]) == 0  # fmt: skip
    done = with_little_room('recover', tmp_path / 'run', '--out', tmp_path / 'new')
    assert done.returncode == 1
    assert 'File too large' in done.stderr
    assert not (tmp_path / 'new').exists()
    assert main(['recover', str(tmp_path / 'run'), '--out', str(tmp_path / 'new')]) == 0
