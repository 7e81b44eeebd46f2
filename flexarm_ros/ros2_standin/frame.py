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

"""The command line of the stand-in, and how it gives way to the real ``ros2``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from importlib import import_module
import os
from pathlib import Path
import shutil
import signal
import sys
from typing import NoReturn

NAME = 'ros2 stand-in of flexarm_ros'
ABOUT = (
    'This is not ros2cli but a small stand-in that flexarm_ros installs where there is no ros2 '
    'command. It has what `Commands` lists, and hands over to the real ros2 when one is on PATH.'
)
MARK = b'flexarm_ros.ros2_standin'
COMMANDS = {
    'run': 'packages',
    'pkg': 'packages',
    'node': 'graph',
    'topic': 'topics',
    'service': 'services',
    'param': 'params',
}
# What the real command has besides; named so that the error can say where to get it.
ELSEWHERE = {
    *('action', 'bag', 'component', 'control', 'daemon', 'doctor', 'extensions', 'interface'),
    *('launch', 'lifecycle', 'multicast', 'security', 'trace', 'wtf'),
}


class Terminated(Exception):
    """SIGTERM came while a verb was waiting."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one ``ros2`` command line and return its exit status; errors go to stderr."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    add_own_prefix()
    real = real_ros2()
    if real is not None:
        hand_over(real, arguments)
    sys.stdout.reconfigure(line_buffering=True)  # type: ignore[union-attr]
    try:
        options = parse(arguments)
        return int(options.verb(options))
    except KeyboardInterrupt:
        return int(signal.SIGINT)
    except Terminated:
        return int(signal.SIGTERM)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except RuntimeError as error:
        print(error, file=sys.stderr)
        return 1


def add_own_prefix() -> None:
    """
    Put this environment on ``AMENT_PREFIX_PATH``, for this process and its children.

    The prefix of a virtual environment is an ament prefix like any other; `ros2 run` finds a
    package by the marker in its ``share/ament_index``.
    """
    prefixes = [p for p in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if p]
    if sys.prefix not in prefixes:
        os.environ['AMENT_PREFIX_PATH'] = os.pathsep.join([*prefixes, sys.prefix])


def real_ros2() -> str | None:
    """Return the first ``ros2`` on ``PATH`` that is not a stand-in."""
    for directory in os.get_exec_path():
        found = shutil.which('ros2', path=directory)
        if found is not None and MARK not in Path(found).read_bytes()[:1000]:
            return found
    return None


def hand_over(real: str, arguments: list[str]) -> NoReturn:
    """Replace this process by the real ``ros2``, without the environment of the wheels."""
    environment = dict(os.environ)
    environment.pop('_ROS_WHEELS_BOOTSTRAP_COMPLETE', None)
    libraries = environment.pop('LD_LIBRARY_PATH', '').split(os.pathsep)
    libraries = [path for path in libraries if path and not path.startswith(sys.prefix)]
    if libraries:
        environment['LD_LIBRARY_PATH'] = os.pathsep.join(libraries)
    os.execve(real, [real, *arguments], environment)


def parse(arguments: list[str]) -> argparse.Namespace:
    """Return the options of a command line, with the function to call as ``verb``."""
    parser = argparse.ArgumentParser(prog='ros2', description=ABOUT)
    parser.add_argument('--version', action='version', version=version())
    commands = parser.add_subparsers(title='Commands', metavar='COMMAND', dest='command')
    wanted = next((word for word in arguments if not word.startswith('-')), None)
    if wanted in ELSEWHERE:
        parser.error(f"'{wanted}' is not in the {NAME}; it needs a ROS 2 install")
    for name, module in COMMANDS.items():
        # Only the given command is imported: `run` and `pkg` need no rclpy.
        text = {'pkg': 'package look-ups'}.get(name, f'{name} commands')
        command = commands.add_parser(name, help=text, description=ABOUT)
        if name == wanted:
            import_module(f'flexarm_ros.ros2_standin.{module}').add_verbs(name, command)
    options = parser.parse_args(arguments)
    if 'verb' not in options:
        (commands.choices[options.command] if options.command else parser).print_help()
        raise SystemExit(0)
    return options


def version() -> str:
    """Return the line of ``--version``."""
    from importlib.metadata import PackageNotFoundError
    from importlib.metadata import version as installed

    try:
        return f'{NAME} {installed("flexarm_ros")} (not ros2cli)'
    except PackageNotFoundError:
        return f'{NAME} (not ros2cli)'
