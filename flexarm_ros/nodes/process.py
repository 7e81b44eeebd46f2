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

"""A process with one node or several: start, spin, signals, exit status."""

from __future__ import annotations

from contextlib import suppress
import gc
from importlib import import_module
import os
import signal
import sys
import threading
import traceback
from typing import Any

from flexarm_ros.core.ending import handle_ending
from flexarm_ros.core.run.answers import ANY_ERROR
from flexarm_ros.core.run.parts import known_parts
from flexarm_ros.nodes.answering import answering_node
from flexarm_ros.nodes.classes import class_of, has_own_node, module_of
from flexarm_ros.nodes.runtime.ending import describe
from flexarm_ros.nodes.runtime.lockstep import spin
from flexarm_ros.nodes.runtime.parameters.declared import parameter_files
from flexarm_ros.nodes.runtime.participant import Participant
from flexarm_ros.nodes.runtime.process.environment import (
    enforce_security,
    environment_domain,
    environment_notes,
    EnvironmentRefused,
)
from flexarm_ros.nodes.runtime.process.middleware import start
from flexarm_ros.nodes.runtime.process.shutdown_watchdog import shutdown_limit
from flexarm_ros.nodes.runtime.process.supervisor import Supervisor
from flexarm_ros.nodes.runtime.topics.channels import connect
from flexarm_ros.scenario import ScenarioError
from flexarm_ros.scenario.nodefile import named_parts, read_sections
from flexarm_ros.scenario.plugins.registry import find_section, role_names
import rclpy
from rclpy.exceptions import ROSInterruptException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

COMPOSE = 'compose'

_RECORDER_NICE = 10
"""Niceness of the recorder: no tick waits for it, so that the other nodes come first."""


def run_process(name: str, argv: list[str]) -> int:
    """Run node ``name`` with a ROS command line; see `flexarm_ros.nodes.main`."""
    try:
        environment_domain()
        enforce_security()
    except EnvironmentRefused as error:
        print(f'{name}: {error}', file=sys.stderr)
        return 2
    for note in environment_notes():
        print(note, file=sys.stderr)
    if name == 'player':
        from flexarm_ros.nodes.player.player import play

        return play(argv)
    if name == 'viewer':
        from flexarm_ros.nodes.view.viewer import view

        return view(argv)
    try:
        if name != COMPOSE and not (name.isidentifier() and find_section(name)):
            names = ', '.join([*role_names(), 'player', 'viewer'])
            print(f'no node {name}: {names}', file=sys.stderr)
            return 2
        start(name, argv)
    except ValueError as error:
        print(f'{name}: {error}', file=sys.stderr)
        return 2
    supervisor, status = Supervisor(), 1
    try:
        status = _run(_composed(argv) if name == COMPOSE else [name], argv, supervisor)
        return status
    except ScenarioError as error:
        print(f'{name}: {error}', file=sys.stderr)
        return 2
    except _rclpy.RCLError as error:  # for example DDS-Security with a Fast DDS without it
        print(f'{name}: {" ".join(str(error).split())[:400]}', file=sys.stderr)
        return 1
    except Exception as error:
        traceback.print_exc()
        supervisor.report(name, phase='failed', blame=name, text=describe(error))
        return 1
    finally:
        with shutdown_limit(status):
            gc.collect()  # a partly created node: destroyed at exit it causes a SIGSEGV
            rclpy.try_shutdown()


def _composed(argv: list[str]) -> list[str]:
    """Return the nodes of this process: those named before the ROS arguments, or all."""
    words = argv[: argv.index('--ros-args')] if '--ros-args' in argv else argv
    optional = [*named_parts(read_sections(parameter_files(argv)))]
    found = [part.NAME for part in known_parts()]
    named = [name for name in found if name in words]
    if named:
        return named
    required = [part.NAME for part in known_parts() if part.Parameters is None]
    return [name for name in found if name in (*required, *optional)]


def _run(names: list[str], argv: list[str], supervisor: Supervisor) -> int:
    if names == ['recorder']:
        os.nice(_RECORDER_NICE)
    nodes = [node_class(name)(argv, supervisor) for name in names]
    for node in nodes:
        node.alone = len(nodes) == 1
    connect((node.inputs.values(), node.outputs.values()) for node in nodes)
    signals = _Signals(nodes)
    executor = SingleThreadedExecutor()
    for node in nodes:
        executor.add_node(node)
    services = threading.Thread(target=_serve, args=(executor, nodes), daemon=True)
    services.start()
    gc.collect()
    gc.freeze()  # no collection visits the objects of the start during the run
    try:
        spin(nodes)
    finally:
        status = signals.status or int(any(n.failure or n.failed_run for n in nodes))
        done = all(node.finished for node in nodes)
        with shutdown_limit(status if done else 1):
            executor.shutdown(timeout_sec=1.0)
            services.join(timeout=1.0)
            for node in nodes:
                node.log_totals()
                node.destroy_node()
    return status


def node_class(role: str) -> type[Participant]:
    """Return the class of the node that fills ``role``."""
    if not has_own_node(role):
        return answering_node(role)
    found: type[Participant] = getattr(import_module(module_of(role)), class_of(role))
    return found


def _serve(executor: SingleThreadedExecutor, nodes: list[Participant]) -> None:
    """Serve parameters and other services; the lock-step loop runs on another thread."""
    try:
        with suppress(ExternalShutdownException, ROSInterruptException):
            executor.spin()
    except ANY_ERROR as error:
        for node in nodes:
            node.crashed = describe(error)


class _Signals:
    """Asks the nodes to leave on a signal; ``status`` is 128 + the signal's number."""

    def __init__(self, nodes: list[Participant]) -> None:
        self._nodes = nodes
        self.status = 0
        handle_ending(self._caught)
        signal.signal(signal.SIGUSR1, self._released)

    def _released(self, _number: int, _frame: Any) -> None:
        for node in self._nodes:
            node.released = True

    def _caught(self, number: int, _frame: Any) -> None:
        self.status = 128 + number
        for node in self._nodes:
            node.interrupted += 1
