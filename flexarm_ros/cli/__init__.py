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
The command ``flexarm``.

Each command is a module here, in `cli.running` (commands that make runs) or in `cli.bags`
(commands that read them), with ``add_parser(make)`` and ``run(args) -> int``, the exit
status.  What several of them share is in `cli.options`.  Only the module of the given command is
imported, so that ``flexarm --help`` is fast and ``simulate`` needs no ROS.  Imports every layer.

Exit status: 0 success; 1 a failed run or check; 2 bad usage or a bad scenario; 3 a bag
recovered in part; 130 after Ctrl-C, 143 after SIGTERM, 129 after SIGHUP.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import errno
import functools
import importlib
import os
import sys
from typing import Any, NoReturn
import warnings

from flexarm_ros.bag.mcap.files import open_standard_files
from flexarm_ros.cli import signals
from flexarm_ros.core.warned import allow_warnings

COMMANDS = {
    'list': ('listing', 'list the shipped scenarios and suites'),
    'run': ('running.run', 'run a scenario as ROS 2 nodes in lock-step and record it'),
    'simulate': ('running.simulate', 'simulate a scenario in one process, without ROS'),
    'suite': ('running.suite', 'run many scenarios and check their expectations'),
    'replay': ('bags.replay', 'publish a recorded run again'),
    'verify': ('bags.verify', 'recompute a recorded run and compare every message'),
    'digest': ('bags.digest', 'print one SHA-256 of all messages of a run'),
    'recover': ('bags.recover', 'recover a damaged bag into a new one'),
    'report': ('bags.report', 'write figures and an HTML report of runs'),
    'modes': ('modes', 'print the natural frequencies of the arm'),
    'sweep': ('running.sweep', 'run a parameter sweep in parallel into one table'),
    'stability': ('stability', 'print eigenvalues and margins of the sampled loop'),
    'predict': ('predict', 'compare a recording of an arm with what a scenario predicts'),
    'fit': ('fit', 'estimate parameters of a scenario from recordings of an arm'),
    'export': ('bags.export', "export a bag's messages as CSV, Parquet or MATLAB files"),
    'compare': ('bags.compare', 'compare the messages of two runs'),
    'view': ('view', 'show a running simulation, or a recorded run, in a browser'),
    'doctor': ('doctor', 'print the real-time permissions and the timing of this machine'),
}
"""Command -> (module of this package, one line of help)."""


class UsageError(Exception):
    """The command line is invalid or cannot be carried out: exit status 2."""


class _Parser(argparse.ArgumentParser):
    """A parser that reports an error in two lines, without the full usage."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        kwargs.setdefault('allow_abbrev', False)
        super().__init__(*args, **kwargs)

    def error(self, message: str) -> NoReturn:
        self.exit(2, f'{self.prog}: error: {message}\nsee: {self.prog} --help\n')


class _Version(argparse.Action):
    """Print the version; it is looked up only when needed."""

    def __call__(self, parser: argparse.ArgumentParser, *rest: Any) -> None:
        from flexarm_ros.cli.version import package_version

        print(f'flexarm {package_version()}')
        parser.exit()


class _Output:
    """
    A standard stream that discards output once its reader or terminal is gone.

    The command still completes and returns its own exit status.
    """

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        try:
            return int(self._stream.write(text))
        except UnicodeEncodeError:  # e.g. a path, where the encoding is ASCII
            encoding = self._stream.encoding
            return self.write(text.encode(encoding, 'backslashreplace').decode(encoding))
        except OSError as error:
            self._discard(error)
            return len(text)

    def flush(self) -> None:
        try:
            self._stream.flush()
        except OSError as error:
            self._discard(error)

    def _discard(self, error: OSError) -> None:
        """Discard the buffered and all later output; a full disk is still an error."""
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, self._stream.fileno())
        os.close(null)
        if error.errno not in (errno.EPIPE, errno.EIO):
            raise error


def build_parser(argv: Sequence[str]) -> argparse.ArgumentParser:
    """Return the parser for ``argv``; only its command's module is imported."""
    parser = _Parser(
        prog='flexarm',
        description='A two-link flexible robot arm as ROS 2 nodes: run, record, replay, analyse.',
        epilog='Start with: flexarm run fls_tip, or flexarm simulate fls_tip (no ROS). '
        'See flexarm COMMAND --help for each command. FLEXARM_DEBUG=1 shows tracebacks.',
    )
    parser.add_argument('--version', action=_Version, nargs=0, help='print the version and exit')
    subparsers = parser.add_subparsers(dest='command', metavar='COMMAND', title='commands')
    wanted = next((word for word in argv if not word.startswith('-')), None)
    for name, (module, summary) in COMMANDS.items():
        if name == wanted:
            make = functools.partial(subparsers.add_parser, name, help=summary)
            importlib.import_module(f'flexarm_ros.cli.{module}').add_parser(make)
        else:
            subparsers.add_parser(name, help=summary, add_help=False)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``flexarm`` and return its exit status (console script entry point)."""
    words = list(sys.argv[1:] if argv is None else argv)
    open_standard_files()
    streams = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (_Output(s) for s in streams)
    try:
        with warnings.catch_warnings(), signals.raising():
            allow_warnings()
            return _guarded(words)
    except signals.Interrupted as stop:
        print(f'flexarm: stopped by {stop}', file=sys.stderr)
        return stop.status
    finally:
        sys.stdout, sys.stderr = streams


def _guarded(words: list[str]) -> int:
    try:
        status = _dispatch(words)
        sys.stdout.flush()
        return status
    except (Exception, SystemExit, KeyboardInterrupt) as error:  # the last two: of a plug-in
        if os.environ.get('FLEXARM_DEBUG', '0') not in ('', '0'):
            raise
        return _explain(words, error)


def _dispatch(words: list[str]) -> int:
    parser = build_parser(words)
    try:
        args = parser.parse_args(words)
        if args.command is None:
            parser.error('give a command')
    except SystemExit as leave:  # --help, --version and errors
        return leave.code if isinstance(leave.code, int) else 0 if leave.code is None else 2
    module = importlib.import_module(f'flexarm_ros.cli.{COMMANDS[args.command][0]}')
    return int(module.run(args))


def _explain(words: list[str], error: BaseException) -> int:
    """Print an error in one or two lines and return its exit status."""
    from flexarm_ros.scenario.errors import clip, PATH_WIDTH, ScenarioError

    command = next((word for word in words if word in COMMANDS), '')
    prefix = f'flexarm {command}'.rstrip()
    if isinstance(error, (ScenarioError, UsageError)):
        print(f'{prefix}: error: {error}', file=sys.stderr)
        return 2
    bag_errors = sys.modules.get('flexarm_ros.bag.errors')
    if bag_errors is not None and isinstance(error, bag_errors.BagError):
        print(f'{prefix}: error: {error}', file=sys.stderr)
        usage = (
            bag_errors.BagExistsError, bag_errors.BagMissingError, bag_errors.UnknownRoleError,
        )  # fmt: skip
        return 2 if isinstance(error, usage) else 1
    answers = sys.modules.get('flexarm_ros.core.run.answers')
    if answers is not None and isinstance(error, (answers.PartError, answers.PartInterrupt)):
        print(f'{prefix}: error: {clip(str(error), 400)}', file=sys.stderr)
        return 1
    if isinstance(error, OSError):
        place = f'{clip(str(error.filename), PATH_WIDTH)}: ' if error.filename is not None else ''
        print(f'{prefix}: error: {place}{error.strerror or error}', file=sys.stderr)
        return 1
    if isinstance(error, UnicodeEncodeError):
        text = clip(ascii(error.object), PATH_WIDTH)
        print(f'{prefix}: error: {text}: cannot be written as {error.encoding}', file=sys.stderr)
        return 2
    text = clip(f'{type(error).__name__}: {error}', 300)
    print(f'{prefix}: internal error: {text}\n(FLEXARM_DEBUG=1 shows where)', file=sys.stderr)
    return 1
