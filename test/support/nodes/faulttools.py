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

"""Runs with a fault, and what must be true of every one of them afterwards."""

from __future__ import annotations

from dataclasses import dataclass, field
import json
import os
from pathlib import Path
import re
import subprocess
import sys
import time

from bagtools import small_messages
from flexarm_ros import scenario
from flexarm_ros.bag.checks.verify import verify
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.launcher import processes, run, shm_cleanup
from flexarm_ros.launcher.faults import FaultPlan
from flexarm_ros.nodes.plant import RECORDER_WINDOW
from flexarm_ros.nodes.trajectory import AHEAD
from flexarm_ros.scenario.suites.suite import Fault
from flexarm_ros.wire.topics import per_tick_topics
from mcap.reader import make_reader
import pytest
from quickstart import Popen
from rclpy import get_rmw_implementation_identifier
from respawntools import RestartPlan, Spare
from rosbags.highlevel import AnyReader

TICKS = 500
CHUNK_TICKS = 50
SIGNALS = ('kill', 'pause', 'restart')
OWN = ('raise', 'exit')
NODE = Path(__file__).with_name('faulty_node.py')

TICK_TIMEOUT_S = 5.0
START_TIMEOUT_S = 20.0
SPARE_TIMEOUT_S = 8.0
"""The same where a node is started again, which waits for it when the others have gone."""

UNREAD_TICKS = 60
"""What a node has sent in the recorder's last 20 ms is gone when it ends without a word."""

AHEAD_S = 6.0
"""Wall time for the ticks that the plant may be ahead of the recorder, and its wait to be read."""

LIMIT_S = TICK_TIMEOUT_S + 0.6 + processes.END_GRACE_S + 2.0
"""Wall time from a fault to the end of all processes: the limit on a tick with the last node's
patience, the look at the verdicts, the time to leave, SIGTERM, SIGKILL."""


def load() -> float:
    """Return how many times longer things take here than on a machine that is not overloaded."""
    return max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))


def inode(name: str) -> int:
    """Return which file of shared memory has this name now, 0 if none."""
    try:
        return (shm_cleanup.FOLDER / name).stat().st_ino
    except OSError:
        return 0


@dataclass
class Faulted:
    """A run that had a fault."""

    directory: Path
    problem: str
    ticks: int
    took_s: float
    """From the fault, or from the last recorded tick before it, to the end."""
    exits: dict[str, int]
    memory: dict[str, int] = field(default_factory=dict)
    """The run's files of shared memory, and the inode of each: others may take up the name."""
    spare: Spare | None = None
    """The node that was started again."""


def faulty_run(
    patch: pytest.MonkeyPatch, directory: Path, role: str, fault: str, tick: int
) -> Faulted:
    """Fly half a second of ``fls_tip`` with one fault in the node ``role`` at ``tick``."""
    limit = SPARE_TIMEOUT_S if fault == 'restart' else START_TIMEOUT_S
    config = scenario.load(
        'fls_tip',
        ['duration=0.5', f'tick_timeout={TICK_TIMEOUT_S}', f'start_timeout={limit}',
         f'recorder.chunk_time={CHUNK_TICKS / 1000}'],
    )  # fmt: skip
    spare: Spare | None = None
    memory: dict[str, int] = {}
    exits: dict[str, int] = {}
    moved = [0.0, -1.0]
    remove, close, command = (
        shm_cleanup.SharedMemoryCleanup.remove,
        processes.NodeProcesses.__exit__,
        run.node_command,
    )

    def remembering(self: shm_cleanup.SharedMemoryCleanup) -> list[str]:
        memory.update((name, inode(name)) for name in self.names)
        return remove(self)

    def closing(self: processes.NodeProcesses, *error: object) -> None:
        close(self, *error)
        exits.update(self.exits)

    def commanding(name: str, arguments: list[str]) -> list[str]:
        if name != role or fault in SIGNALS:
            return command(name, arguments)
        words = [sys.executable, str(NODE), name, fault, str(tick), '--ros-args']
        return words + arguments

    def watching(done: int, _: int) -> None:
        if done != moved[1]:
            moved[:] = [time.monotonic(), done]

    patch.setattr(shm_cleanup.SharedMemoryCleanup, 'remove', remembering)
    patch.setattr(processes.NodeProcesses, '__exit__', closing)
    patch.setattr(run, 'node_command', commanding)
    timeline = Timeline.of(config.run)
    plan = None
    if fault == 'restart':
        patch.setattr(subprocess, 'Popen', Popen)  # the spare reads the node's environment
        plan = RestartPlan([Fault(tick / 1000, role, 'kill')], timeline)
        plan.spare = spare = Spare(directory.with_name('spare.log'))
    elif fault in SIGNALS:
        plan = FaultPlan([Fault(tick / 1000, role, fault)], timeline)
    outcome = run.run_scenario(
        config, 'fls_tip', directory, run.RunOptions(), watch=watching, faults=plan
    )
    took = time.monotonic() - moved[0]
    summary = json.loads((directory / 'summary.json').read_text())
    # References are out long before their tick: without its trajectory a run may still be whole.
    assert summary['stable'] is not True or summary['ticks'] == TICKS
    assert summary['problem'] == outcome.problem
    check_bag(directory, config, summary['ticks'], gone=role)
    return Faulted(directory, outcome.problem, summary['ticks'], took, exits, memory, spare)


def check_bag(directory: Path, config: RunConfig, ticks: int, gone: str = '') -> None:
    """Check that a bag opens and holds, for ``ticks`` ticks, the bytes of an undisturbed run."""
    bag = directory / 'bag'
    if not bag.exists():
        assert ticks == 0
        return
    wanted = small_messages(config)
    paths = [topic.path for topic in per_tick_topics(config)]
    with open(bag / 'bag_0.mcap', 'rb') as file:
        messages = [
            (channel.topic, message.sequence - 1, message.data)
            for _, channel, message in make_reader(file).iter_messages()
        ]
    by_tick: dict[tuple[int, str], bytes] = {}
    for topic, tick, data in messages:
        assert (tick, topic) not in by_tick, f'twice: {topic} at tick {tick}'
        by_tick[tick, topic] = data
        assert data == wanted[tick][paths.index(topic)], f'{topic} at tick {tick}'
    whole = [k for k in range(TICKS) if all((k, path) in by_tick for path in paths)]
    assert whole == list(range(ticks))
    # Of the tick that was not finished there may be some messages, of later ones none.
    # But where a node has gone without a word, and what nobody had read of it with it; and
    # where the recorder stood still: by the time it reads on, the others have gone with theirs.
    missing = {path for path in paths if (ticks, path) not in by_tick}
    lost = {t.path for t in per_tick_topics(config) if gone in (t.node, 'recorder')}
    if gone == 'plant':  # references are kept as far as there are states
        lost |= {t.path for t in per_tick_topics(config) if t.node == 'trajectory'}
    if not missing <= lost:
        assert max((tick for tick, _ in by_tick), default=-1) <= ticks, sorted(by_tick)[-12:]
    verdict = verify(directory)
    assert verdict.same is bool(messages), (verdict.faults, verdict.earliest)  # none prove nothing
    assert verdict.ticks >= ticks
    with AnyReader([bag]) as reader:
        assert sum(1 for _ in reader.messages()) == len(messages)
    rows = (directory / 'trajectory.csv').read_text().splitlines()
    assert len(rows) == 1 + ticks


def check_end(done: Faulted, role: str, fault: str, tick: int) -> None:
    """Check that the node, the tick and why are told, and that nothing is left behind."""
    said = done.problem
    assert said.startswith(f'{role}: tick '), said
    assert '\n' not in said
    assert len(said) < 400
    why = {'kill': 'killed by SIGKILL', 'restart': 'killed by SIGKILL', 'pause': 'within',
           'raise': 'ZeroDivisionError: a fault on purpose',
           'exit': 'ended with exit status 0'}  # fmt: skip
    assert why[fault] in said
    named = int(said.split()[2].rstrip(':'))
    # The plant's state of a tick is out before its own turn comes again. The trajectory publishes
    # AHEAD ticks beyond what it heard of, and the plant flies AHEAD ticks at most beyond that.
    ahead = {'plant': 1, 'trajectory': 2 * AHEAD, 'recorder': RECORDER_WINDOW}.get(role, 0)
    unread = UNREAD_TICKS if fault in ('exit', 'kill', 'restart') else 0
    assert tick - max(ahead, unread) <= named <= min(tick + ahead, TICKS), said
    # A recorder that ends without a word has its last chunk in memory.
    lost = CHUNK_TICKS if role == 'recorder' and fault in ('exit', 'kill', 'restart') else 0
    assert done.ticks >= min(tick, named) - lost - 1
    # The plant leaves when it is done, though the recorder, which is behind it, stands still.
    limit = LIMIT_S + (run.LEAVING_S - TICK_TIMEOUT_S + AHEAD_S) * ('did not leave' in said)
    assert done.took_s < limit * load(), f'{said}, after {done.took_s} s'
    if get_rmw_implementation_identifier().startswith('rmw_fastrtps'):
        assert done.memory, 'no shared memory was noted'
    # Ports are numbered for the whole machine: somebody else's run may have taken one over.
    left = [name for name, number in done.memory.items() if number and inode(name) == number]
    left = [name for name in left if not shm_cleanup.in_use(shm_cleanup.FOLDER / f'{name}_el')]
    assert not left, left


def check_spare(done: Faulted) -> None:
    """See that the node that was started again leaves with one clear line, and changes nothing."""
    assert done.spare is not None
    before = contents(done.directory)
    said = done.spare.end(2 * SPARE_TIMEOUT_S + 30.0 * load())
    assert done.spare.process.returncode == 1, said
    (line,) = said.splitlines()
    assert re.search(r'refused: |start: no \S.* joined within 8 s', line), said
    assert contents(done.directory) == before


def contents(directory: Path) -> dict[Path, bytes]:
    """Return every file below ``directory``."""
    return {path: path.read_bytes() for path in directory.rglob('*') if path.is_file()}
