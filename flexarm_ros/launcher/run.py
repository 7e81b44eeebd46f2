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

"""One run: reserve a domain, start the nodes, watch them, finish the files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
import errno
from functools import partial
import json
import os
from pathlib import Path
import shutil
import sys
import time

from flexarm_ros import scenario
from flexarm_ros.bag.errors import BagError
from flexarm_ros.bag.mcap.files import write_atomically
from flexarm_ros.bag.recording import BAG, finish_run, prepare_directory, Work
from flexarm_ros.core.parameters.sections import PaceParameters, RunConfig, specs
from flexarm_ros.core.run.parts import replaceable, roles
from flexarm_ros.core.run.required_parts import ControllerPart
from flexarm_ros.core.run.results.real_time import outlives_controller
from flexarm_ros.launcher.domains import reserved_domain
from flexarm_ros.launcher.faults import FaultPlan
from flexarm_ros.launcher.processes import END_GRACE_S, node_command, NodeProcesses
from flexarm_ros.launcher.reports import RunWatch
from flexarm_ros.nodes.runtime.parameters.own import how_to_go_on
from flexarm_ros.nodes.runtime.process.environment import log_directory
from flexarm_ros.scenario.yaml.rclyaml import quoted
from flexarm_ros.wire.fused_step import warm_up_nodes

VERDICT_S = 0.3
"""Wall time after the first failure for reports that are closer to the cause."""

LEAVING_S = 5.0
"""Wall time without progress after which a node must have left once the plant has."""


@dataclass(frozen=True)
class RunOptions:
    """
    Options of a run, apart from the scenario.

    ``rtf`` limits the run to a multiple of real time (0: as in the scenario);
    ``attended``: the scenario's ``start_paused`` applies, since a user can start the run;
    ``namespace`` is that of all nodes, as ``/left``, empty for none;
    ``domain`` is None for a free one; ``without`` lists roles of external
    nodes, ``nodes`` those whose command is given: started with the
    others, ended with the run; ``discovery`` is ROS_AUTOMATIC_DISCOVERY_RANGE.
    """

    compose: bool = False
    rtf: float = 0.0
    attended: bool = False
    namespace: str = ''
    domain: int | None = None
    without: tuple[str, ...] = ()
    nodes: Mapping[str, Sequence[str]] = field(default_factory=dict)
    discovery: str = 'LOCALHOST'


@dataclass
class RunOutcome:
    """The end of a run: ``problem`` is one line, empty on success."""

    directory: Path
    summary: dict[str, object] = field(default_factory=dict)
    problem: str = ''
    interrupted: bool = False

    @property
    def stable(self) -> bool:
        """Whether the arm stayed within its bounds."""
        return bool(self.summary.get('stable'))


Watch = Callable[[int, int], None]
"""Called with the number of recorded ticks and the total."""


def run_scenario(
    config: RunConfig,
    name: str,
    directory: Path,
    options: RunOptions,
    announce: Callable[[str], None] = lambda _: None,
    watch: Watch = lambda *_: None,
    stop: Callable[[], bool] = lambda: False,
    faults: FaultPlan | None = None,
    verdict: Callable[[str], None] = lambda _: None,
    work: Work = lambda *_: None,
    beside: Callable[[int], AbstractContextManager[None]] = lambda _: nullcontext(),
    timing: Callable[[str], None] = lambda _: None,
) -> RunOutcome:
    """
    Run ``config`` as ROS 2 nodes and return the outcome.

    ``directory`` must not exist, or be empty.  ``stop`` is called often; once it returns True the
    run is ended in order.  ``verdict`` gets the outcome's ``problem`` as soon as a node has made
    the run fail, before the nodes have ended and the files are finished; ``work`` receives the
    progress of the bag's recovery, ``timing`` the timing of a free-running run so far; ``beside``
    returns, for the ROS domain, a context that lasts as long as the nodes run.  Raises
    NoDomainError, OSError or BagError before anything is started, BagError too if the files of a
    run without a problem cannot be finished.
    """
    check_roles(options.without, config)
    check_commands(options.nodes, config)
    with reserved_domain(options.domain) as domain:
        external = (*options.without, *options.nodes)
        prepare_directory(directory, config, name, external)
        announce(f'ROS_DOMAIN_ID={domain}')
        if config.pace.start_paused and options.attended:
            go_on = how_to_go_on(f'{options.namespace}/plant')
            announce(f'begins paused; to begin: ROS_DOMAIN_ID={domain} {go_on}')
        commands = _commands(config, name, directory, options, faults)
        environment, logs = _environment(domain, options), directory / 'logs'
        for again in (True, False):
            with beside(domain), NodeProcesses(
                commands, environment, logs, options.nodes,
                scenario=str(_resolved(directory)), compile_here=partial(warm_up_nodes, config),
            ) as nodes:  # fmt: skip
                nodes.dispensable = dispensable(config)
                broken_off = partial(_tell, nodes, verdict, external if again else None)
                interrupted = _supervise(
                    nodes, config, Reported(watch, announce, timing), stop, faults, broken_off
                )
            if not again or interrupted or not nodes.never_met(external):
                break
            announce(f'{nodes.blame()}; starting the nodes again')
            _set_aside(directory, logs)
    return finish(directory, config, name, nodes, interrupted, external, work)


def dispensable(config: RunConfig) -> frozenset[str]:
    """Return the roles whose end does not end the run."""
    return frozenset([ControllerPart.NAME] if outlives_controller(config) else [])


class Reported:
    """Passes on the reports of the nodes during a run."""

    def __init__(
        self, watch: Watch, announce: Callable[[str], None], timing: Callable[[str], None]
    ) -> None:
        self._watch, self._announce, self._timing = watch, announce, timing

    def __call__(self, nodes: RunWatch, total: int) -> None:
        """Pass on new reports; ``total``: ticks of the run."""
        report = nodes.report
        while report.remarks:
            self._announce(report.remarks.pop(0))
        self._timing(report.timing)
        self._watch(report.tick, total)


def _tell(
    nodes: NodeProcesses, verdict: Callable[[str], None], again_without: Sequence[str] | None
) -> None:
    """Report why the run failed, unless its nodes did not connect and start again."""
    if again_without is None or not nodes.never_met(again_without):
        verdict(nodes.settle())


def _set_aside(directory: Path, logs: Path) -> None:
    """Keep the nodes' logs of a failed start; remove the bag that they began."""
    os.replace(logs, logs.with_name(f'{logs.name}-first-start'))
    shutil.rmtree(directory / BAG, ignore_errors=True)


def finish(
    directory: Path,
    config: RunConfig,
    name: str,
    nodes: RunWatch,
    interrupted: bool,
    external: Sequence[str] = (),
    work: Work = lambda *_: None,
    beside: Callable[[int], AbstractContextManager[None]] = lambda _: nullcontext(),
) -> RunOutcome:
    """
    Write the remaining files after all nodes have ended; return the outcome.

    Raises BagError if that fails and the run has no other problem.
    """
    outcome = RunOutcome(directory, problem=nodes.blame(interrupted), interrupted=interrupted)
    report = nodes.report
    started, ended = report.started_at, report.ended_at
    wall_s = ended - started if started is not None and ended is not None else None
    try:
        outcome.summary = finish_run(
            directory, config, name, wall_s=wall_s, problem=outcome.problem,
            unstable=(report.unstable_tick, report.unstable) if report.unstable else None,
            external=external, work=work,
        )  # fmt: skip
    except (
        BagError
    ) as error:  # for example a full disk: the reason of the end is reported in any case
        if not outcome.problem:
            raise
        outcome.problem += f'; {error}'
        outcome.summary = {'problem': outcome.problem}
    outcome.problem = outcome.problem or str(outcome.summary['problem'])
    return outcome


def check_roles(external: Iterable[str], config: RunConfig) -> None:
    """Raise ``ValueError`` for a role that an external node cannot fill in this scenario."""
    allowed = replaceable(config)
    for role in external:
        if role not in allowed:
            raise ValueError(f'{role}: not a node to replace: {", ".join(allowed)}')


def check_commands(nodes: Mapping[str, Sequence[str]], config: RunConfig) -> None:
    """Check that the commands of external nodes can be started; FileNotFoundError if not."""
    check_roles(nodes, config)
    for role, words in nodes.items():
        if not words or shutil.which(words[0]) is None:
            name = words[0] if words else ''
            raise FileNotFoundError(errno.ENOENT, f'{role}: no such command', name)


def _commands(
    config: RunConfig, name: str, directory: Path, options: RunOptions, faults: FaultPlan | None
) -> dict[str, list[str]]:
    """Write the normalised scenario and return the command line of each process."""
    shared = ['--params-file', str(write_resolved(directory, config))]
    if options.namespace:
        shared += ['-r', f'__ns:={options.namespace}']
    pace = replace(
        config.pace,
        real_time_factor=options.rtf or config.pace.real_time_factor,
        start_paused=config.pace.start_paused and options.attended,
    )
    own = own_arguments(directory, name, pace, faults.ticks if faults is not None else ())
    external = (*options.without, *options.nodes)
    started = [role for role in roles(config) if role not in external]
    if options.compose:
        every = [word for role in started for word in own.get(role, [])]
        return {'compose': node_command('compose', shared + every, started)}
    return {role: node_command(role, shared + own.get(role, [])) for role in started}


def write_resolved(directory: Path, config: RunConfig) -> Path:
    """Write every parameter of the run to a file for the nodes; return its path."""
    torques = (directory / 'torques.csv').resolve()
    if config.torques:
        write_atomically(torques, scenario.write_torques(config.torques))
    resolved = _resolved(directory)
    write_atomically(resolved, scenario.dump(config, str(torques) if config.torques else None))
    return resolved


def own_arguments(
    directory: Path, name: str, pace: PaceParameters, hold_at: Sequence[int] = ()
) -> dict[str, list[str]]:
    """Return the ROS arguments of the nodes with parameters outside the scenario."""
    plant = [
        f'plant:{key}:={_yaml(getattr(pace, field))}'
        for key, (field, _, default) in specs(PaceParameters).items()
        if getattr(pace, field) != default
    ]
    if hold_at:
        plant.append("plant:hold_at:='" + ','.join(map(str, hold_at)) + "'")
    record = [
        f'recorder:output:={quoted(str(directory.resolve()))}',
        f'recorder:name:={quoted(name)}',
    ]
    return {'plant': _overrides(plant), 'recorder': _overrides(record)}


def _resolved(directory: Path) -> Path:
    return (directory / 'scenario.yaml').resolve()


def _yaml(value: float) -> str:
    """Return ``value`` as rcl reads it: 1e-05 would be a string."""
    if not isinstance(value, float):
        return json.dumps(value)
    mantissa, exponent, power = repr(float(value)).partition('e')
    return f'{mantissa}{"" if "." in mantissa else ".0"}{exponent}{power}'


def _overrides(values: list[str]) -> list[str]:
    return [word for value in values for word in ('-p', value)]


def _environment(domain: int, options: RunOptions) -> dict[str, str]:
    return {
        **os.environ,
        'ROS_DOMAIN_ID': str(domain),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': options.discovery,
        'ROS_LOG_DIR': log_directory(),  # a path independent of a node's working directory
        'PYTHONPATH': os.pathsep.join(p for p in sys.path if p),
    }


def _supervise(
    nodes: NodeProcesses,
    config: RunConfig,
    watch: Reported,
    stop: Callable[[], bool],
    faults: FaultPlan | None,
    broken_off: Callable[[], None],
) -> bool:
    """
    Watch the nodes until all have left; True where ``stop`` ended the run.

    ``broken_off`` is called if a node has made it fail, before the nodes are ended.
    """
    total = round(config.run.duration / config.run.control_period)
    leaving = _Leaving(max(LEAVING_S, config.run.tick_timeout))
    while nodes.ours:
        nodes.poll(0.05)
        if faults is not None:
            faults(nodes)
        watch(nodes, total)
        if stop():
            nodes.interrupt_run()
            nodes.end(config.run.tick_timeout)
            return True
        if nodes.failing:
            _await_verdict(nodes)
            if not nodes.failing:
                continue
            nodes.interrupt_run(times=2)
            broken_off()
            nodes.end(END_GRACE_S)
            return False
        if 'plant' in nodes.report.done:
            leaving.check(nodes)
    watch(nodes, total)
    nodes.end(0.0)  # external nodes may not know that the run is over
    return False


def _await_verdict(nodes: NodeProcesses) -> None:
    """Read the reports after the first failure; for a dead node, the recorder's last ticks."""
    deadline = time.monotonic() + VERDICT_S
    nodes.poll(VERDICT_S)
    while nodes.deaths and (left := deadline - time.monotonic()) > 0.0:
        nodes.poll(left)


class _Leaving:
    """The end of a run: nodes leave one by one, and the recorder writes the rest."""

    def __init__(self, limit_s: float) -> None:
        self._limit_s = limit_s
        self._state: tuple[int, int] | None = None
        self._since = 0.0

    def check(self, nodes: NodeProcesses) -> None:
        """
        Report the nodes that are not done if nothing has happened within the limit.

        Nodes that are done have sent all messages and closed their files: Fast DDS may block
        such a process on exit (see `flexarm_ros.nodes.runtime.process.shutdown_watchdog`).
        They are ended.
        """
        now = time.monotonic()
        state = (len(nodes.ours), nodes.report.tick)
        if state != self._state:
            self._state, self._since = state, now
            return
        idle = now - self._since
        late = ', '.join(nodes.busy)
        if not late and idle > LEAVING_S:
            nodes.end(0.0)
        elif late and idle > self._limit_s:
            text = f'tick {nodes.report.tick}: did not leave within {self._limit_s:g} s of the end'
            nodes.report.failures.append({'role': late, 'blame': late, 'text': text})
