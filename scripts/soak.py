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

"""
Start runs back to back and watch for what grows: ``make soak SOAK_MINUTES=30``.

One long run comes first (a quarter of the time, ended in good order), then short ones of several
kinds in turn until the time is up.  Watched are: the bytes of each bag (equal to those of `flexarm
simulate`), resident memory, threads and file handles of this process, which is the launcher of
every run, and of each node from early in the long run to its end, and the shared memory that the
nodes leave behind.  Ends with status 1 where something grows, and writes every sample as JSON.
Make no commit meanwhile: a bag names that of its source.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
import gc
import hashlib
import json
import os
from pathlib import Path
import shutil
import sys
import tempfile
import time
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.bag.checks.verify import verify
from flexarm_ros.bag.simulation import simulate
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.launcher import run
from flexarm_ros.launcher import shm_cleanup as litter
from flexarm_ros.launcher.faults import FaultPlan
from flexarm_ros.launcher.processes import NodeProcesses

SHORT = {
    'fls_tip': (['duration=1'], False),
    'pd_mid_corrected, noisy': (
        ['duration=1', 'encoder.noise_std=0.0001', 'tip_sensor.noise_std=0.001'], False,
    ),
    'fls_full': (['duration=0.3'], False),
    'fls_tip, one process': (['duration=1'], True),
}  # fmt: skip
"""Name -> overrides, and whether all nodes are in one process."""

SETTLED_RUNS = 8
"""Runs after which the launcher has imported and cached what it ever will."""

SETTLED_PART = 0.2
"""Part of the long run after which the nodes have."""

GROWTH_MIB = 4.0
"""Resident memory that may come on top, in MiB: some 2 % of a node's; a leak of a hundred bytes a
tick shows beyond it within a minute."""


@dataclass
class Sample:
    """What one process holds."""

    rss_mib: float
    threads: int
    handles: int

    @classmethod
    def of(cls, pid: int) -> Sample | None:
        """Return the sample of a living process, None of one that has ended."""
        folder = Path('/proc') / str(pid)
        try:
            status = dict(
                line.split(':', 1) for line in (folder / 'status').read_text().splitlines()
            )
            handles = len(os.listdir(folder / 'fd'))
            return cls(int(status['VmRSS'].split()[0]) / 1024, int(status['Threads']), handles)
        except (OSError, KeyError):
            return None


@dataclass
class Soak:
    """The samples of one soak and what was found wrong."""

    seconds: float
    launcher: list[Sample] = field(default_factory=list)
    nodes: dict[str, list[Sample]] = field(default_factory=dict)
    runs: dict[str, int] = field(default_factory=dict)
    hashes: dict[str, str] = field(default_factory=dict)
    memory: set[str] = field(default_factory=set)
    shm_before: int = 0
    ticks: int = 0
    faults: list[str] = field(default_factory=list)

    def expect(self, fine: bool, text: str) -> None:
        """Note a fault."""
        if not fine:
            self.faults.append(text)
            print(f'soak: {text}', flush=True)


def digest(bag: Path) -> str:
    """Return the hash of a bag's messages file."""
    return hashlib.sha256((bag / 'bag_0.mcap').read_bytes()).hexdigest()


def shm_files() -> int:
    """Count the files of Fast DDS in shared memory, ours and others'."""
    return sum(
        1
        for name in os.listdir(litter.FOLDER)
        if name.removeprefix('sem.').startswith(litter.PREFIXES)
    )


class NodeWatch(FaultPlan):
    """Samples each node of a run once a second; it does nothing to them."""

    def __init__(self, soak: Soak, timeline: Timeline) -> None:
        super().__init__([], timeline)
        self._soak = soak
        self._last = 0.0

    def __call__(self, nodes: NodeProcesses) -> None:
        """Sample, from the first recorded tick on."""
        now = time.monotonic()
        if nodes.report.tick < 1 or now - self._last < 1.0:
            return
        self._last = now
        for name, process in nodes.running.items():
            sample = Sample.of(process.pid)
            if sample is not None:
                self._soak.nodes.setdefault(name, []).append(sample)


def long_run(soak: Soak, folder: Path) -> None:
    """Run one scenario for a quarter of the time and check every message of its bag."""
    config = scenario.load('fls_tip', [f'duration={max(1, round(soak.seconds))}',
                                       'trajectory.kind=hold'])  # fmt: skip
    end = time.monotonic() + soak.seconds / 4
    out = folder / 'long'
    outcome = run.run_scenario(
        config, 'long', out, run.RunOptions(), stop=lambda: time.monotonic() > end,
        faults=NodeWatch(soak, Timeline.of(config.run)),
    )  # fmt: skip
    soak.expect(outcome.problem in ('', 'interrupted'), f'the long run: {outcome.problem}')
    result = verify(out)
    soak.expect(result.same, "the long run's bag does not verify")
    soak.ticks = int(str(outcome.summary['ticks']))
    for name, samples in soak.nodes.items():
        settled = after_start(samples)[:-1]
        if len(settled) > 4:
            check_growth(soak, f'{name} in the long run', settled)
    shutil.rmtree(out)


def check_growth(soak: Soak, who: str, samples: list[Sample]) -> None:
    """Compare the last quarter with the first."""
    part = max(1, len(samples) // 4)
    first, last = samples[:part], samples[-part:]
    grown = max(s.rss_mib for s in last) - max(s.rss_mib for s in first)
    soak.expect(grown <= GROWTH_MIB, f'{who}: {grown:.1f} MiB more resident memory')
    for what in ('threads', 'handles'):
        before, after = (max(getattr(s, what) for s in group) for group in (first, last))
        soak.expect(after <= before, f'{who}: {before} {what}, then {after}')


def short_run(soak: Soak, folder: Path, name: str) -> None:
    """Make one short run and compare its bag with the simulation's."""
    overrides, compose = SHORT[name]
    config = scenario.load(name.split(',')[0], overrides)
    key = name.split(', one')[0]
    if key not in soak.hashes:
        simulate(config, folder / 'simulated', key)
        soak.hashes[key] = digest(folder / 'simulated' / 'bag')
        shutil.rmtree(folder / 'simulated')
    out = folder / 'short'
    outcome = run.run_scenario(config, key, out, run.RunOptions(compose=compose))
    soak.expect(not outcome.problem, f'{name}: {outcome.problem}')
    if not outcome.problem:
        soak.expect(digest(out / 'bag') == soak.hashes[key], f'{name}: other bytes')
    shutil.rmtree(out)
    soak.runs[name] = soak.runs.get(name, 0) + 1


def remember_memory(soak: Soak) -> None:
    """Note every file of shared memory that the launcher knows its nodes to hold."""
    remove = litter.SharedMemoryCleanup.remove

    def remembering(self: litter.SharedMemoryCleanup) -> list[str]:
        soak.memory.update(self.names)
        return remove(self)

    litter.SharedMemoryCleanup.remove = remembering  # type: ignore[method-assign]


def left_behind(soak: Soak) -> list[str]:
    """Return the files of shared memory of our nodes that are still there and held by nobody."""
    again = litter.SharedMemoryCleanup()
    again.names = set(soak.memory)
    names = [name for name in again.names if (litter.FOLDER / name).exists()]
    return [name for name in names if not litter.in_use(litter.FOLDER / (name + '_el'))]


def soak_for(minutes: float, folder: Path) -> Soak:
    """Run until the time is up."""
    soak = Soak(minutes * 60.0)
    soak.shm_before = shm_files()
    remember_memory(soak)
    end = time.monotonic() + soak.seconds
    long_run(soak, folder)
    while time.monotonic() < end:
        for name in SHORT:
            short_run(soak, folder, name)
        gc.collect()
        sample = Sample.of(os.getpid())
        if sample is not None:
            soak.launcher.append(sample)
        print(f'soak: {sum(soak.runs.values())} runs, {sample}', flush=True)
    warm_up = SETTLED_RUNS // len(SHORT)
    settled = soak.launcher[warm_up:]
    soak.expect(len(settled) >= 2, 'too short to tell whether the launcher grows')
    if len(settled) >= 2:
        check_growth(soak, 'launcher', settled)
    left = left_behind(soak)
    soak.expect(not left, f'left in /dev/shm: {", ".join(left[:5])}')
    return soak


def after_start(samples: list[Sample]) -> list[Sample]:
    """Return the samples after `SETTLED_PART` of the long run."""
    first = int(len(samples) * SETTLED_PART)
    return samples[first:]


def figures(soak: Soak) -> dict[str, Any]:
    """Return what a page about reliability wants to know."""

    def span(samples: list[Sample]) -> dict[str, Any]:
        settled = after_start(samples) or samples
        return {
            what: [getattr(settled[0], what), getattr(settled[-1], what)]
            for what in ('rss_mib', 'threads', 'handles')
        }

    return {
        'minutes': round(soak.seconds / 60, 2),
        'long_run_ticks': soak.ticks,
        'runs': soak.runs,
        'launcher_first_last': span(soak.launcher) if soak.launcher else None,
        'nodes_first_last': {
            name: span(samples[:-1] or samples) for name, samples in soak.nodes.items()
        },
        'shm_files_of_our_nodes': len(soak.memory),
        'shm_files_left_of_ours': len(left_behind(soak)),
        'shm_files_before_after': [soak.shm_before, shm_files()],
        'faults': soak.faults,
    }


def main() -> int:
    """Soak; 0 where nothing grew and every bag was as it should be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--minutes', type=float, default=30.0)
    parser.add_argument('--json', type=Path, default=Path('runs/soak.json'))
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        soak = soak_for(args.minutes, Path(folder))
    told = figures(soak)
    args.json.parent.mkdir(parents=True, exist_ok=True)
    args.json.write_text(json.dumps(told, indent=1) + '\n', encoding='utf-8')
    print(json.dumps(told, indent=1))
    return 1 if soak.faults else 0


if __name__ == '__main__':
    sys.exit(main())
