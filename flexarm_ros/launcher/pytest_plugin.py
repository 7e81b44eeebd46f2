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
Pytest plugin: run scenarios and suites from a test, with external nodes in the loop.

It is available wherever this package is installed (entry point ``pytest11``), and has no cost
until a test uses one of its fixtures.  See docs/testing.md.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
import importlib.util
from pathlib import Path
from typing import Any, TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from flexarm_ros.bag.checks.verify import Verdict
    from flexarm_ros.launcher.suite import SuiteResult
    from flexarm_ros.wire.cdr import FloatArray

Command = Sequence[str | Path]


@dataclass(frozen=True)
class FinishedRun:
    """
    One run in a test; ``run["max_error"]`` is a key of ``summary.json``.

    ``directory`` has the bag, ``summary.json``, ``trajectory.csv`` and the logs;
    ``problem`` is one line, empty on success.
    """

    directory: Path
    summary: Mapping[str, Any]
    problem: str

    @property
    def stable(self) -> bool:
        """Whether the run reached its end within the arm's bounds."""
        return self.summary.get('stable') is True and not self.problem

    def __getitem__(self, metric: str) -> Any:
        return self.summary[metric]

    @property
    def trajectory(self) -> dict[str, FloatArray]:
        """Return the columns of ``trajectory.csv``: one value per tick, shape ``(ticks,)``."""
        import numpy as np

        with open(self.directory / 'trajectory.csv', encoding='ascii') as file:
            names = file.readline().strip().split(',')
            table = np.loadtxt(file, delimiter=',', ndmin=2)
        return dict(zip(names, table.reshape(-1, len(names)).T, strict=True))

    def log(self, node: str) -> str:
        """Return the output of a node."""
        return (self.directory / 'logs' / f'{node}.log').read_text(errors='replace')

    def verify(self) -> Verdict:
        """Recompute every message of the package's nodes, as ``flexarm verify`` does."""
        from flexarm_ros.bag.checks.verify import verify

        return verify(self.directory)


@pytest.fixture
def flexarm_run(tmp_path: Path) -> Callable[..., FinishedRun]:
    """
    Return a function that runs a scenario.

    ``flexarm_run(scenario, settings, nodes={"controller": [...]})``: ``scenario``
    is a file or the name of a shipped one, ``settings`` maps keys such as
    ``duration`` or ``plant.payload_mass`` to values, ``nodes`` maps the roles of
    external nodes to their commands, ``mode`` is ``run`` (a process each),
    ``compose`` or ``simulate``.  Each run has its own ROS domain, so tests may
    run concurrently.
    """
    count = 0

    def run(
        scenario: str | Path,
        settings: Mapping[str, Any] | None = None,
        *,
        nodes: Mapping[str, Command] | None = None,
        mode: str = 'run',
    ) -> FinishedRun:
        nonlocal count
        count += 1
        directory = tmp_path / f'run-{count}'
        finished = _run(scenario, settings or {}, _words(nodes), mode, directory)
        print(f'flexarm: {scenario}: {finished.problem or "completed"}; see {directory}')
        return finished

    return run


@pytest.fixture
def flexarm_suite(tmp_path: Path) -> Callable[..., SuiteResult]:
    """
    Return a function that runs a suite.

    ``assert not flexarm_suite("suite.yaml").failures()``; ``nodes`` as in
    `flexarm_run`: they take part in every case except simulated ones.
    """

    def run(
        suite: str | Path, *, nodes: Mapping[str, Command] | None = None, jobs: int = 0
    ) -> SuiteResult:
        from flexarm_ros.launcher.run import check_commands
        from flexarm_ros.launcher.suite import default_jobs, run_suite
        from flexarm_ros.scenario.suites.suite import load

        loaded, words = load(suite), _words(nodes)
        for case in loaded.cases:
            check_commands(words, case.config)
        if any(case.mode != 'simulate' for case in loaded.cases):
            _need_ros()
        out = tmp_path / loaded.name
        result = run_suite(loaded, out, jobs or default_jobs(loaded), nodes=words)
        print(f'flexarm: {suite}: {"passes" if result.passed else "fails"}; see {out}')
        return result

    return run


def _run(
    name: str | Path,
    settings: Mapping[str, Any],
    nodes: Mapping[str, Sequence[str]],
    mode: str,
    directory: Path,
) -> FinishedRun:
    from flexarm_ros import scenario
    from flexarm_ros.scenario.yaml.rclyaml import quoted

    config = scenario.load(name, [f'{key}={quoted(value)}' for key, value in settings.items()])
    stem = Path(name).stem
    if mode == 'simulate':
        if nodes:
            raise ValueError("mode 'simulate' starts no nodes; use mode 'run'")
        from flexarm_ros.bag.simulation import simulate

        summary = simulate(config, directory, stem)
        return FinishedRun(directory, summary, str(summary.get('problem') or ''))
    if mode not in ('run', 'compose'):
        raise ValueError(f'mode {mode!r} is not allowed: run, compose or simulate')
    _need_ros()
    from flexarm_ros.launcher.run import run_scenario, RunOptions

    options = RunOptions(compose=mode == 'compose', nodes=nodes)
    outcome = run_scenario(config, stem, directory, options)
    return FinishedRun(directory, outcome.summary, outcome.problem)


def _words(nodes: Mapping[str, Command] | None) -> dict[str, list[str]]:
    return {role: [str(word) for word in command] for role, command in (nodes or {}).items()}


def _need_ros() -> None:
    if importlib.util.find_spec('rclpy') is None:
        pytest.fail("rclpy is not installed or not sourced; mode='simulate' needs no ROS")
