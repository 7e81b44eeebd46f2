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

"""``ros2 run`` and ``ros2 pkg``: what is in the ament index."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
import shlex

from ament_index_python.packages import (
    get_package_prefix,
    get_package_share_directory,
    get_packages_with_prefixes,
    PackageNotFoundError,
)


def add_verbs(name: str, command: argparse.ArgumentParser) -> None:
    """Add the options of ``run``, or the verbs of ``pkg``."""
    if name == 'run':
        command.usage = 'ros2 run [-h] [--prefix PREFIX] package_name executable_name ...'
        command.add_argument('--prefix', help='command to put before the executable')
        command.add_argument('package_name')
        command.add_argument('executable_name')
        command.add_argument('argv', nargs=argparse.REMAINDER, help='arguments of the executable')
        command.set_defaults(verb=run)
        return
    verbs = command.add_subparsers(title='Verbs', metavar='VERB')
    verb = verbs.add_parser('list', help='names of the installed packages')
    verb.set_defaults(verb=list_packages)
    verb = verbs.add_parser('executables', help='executables of a package, or of all')
    verb.add_argument('package_name', nargs='?')
    verb.add_argument('--full-path', action='store_true')
    verb.set_defaults(verb=list_executables)
    verb = verbs.add_parser('prefix', help='where a package is installed')
    verb.add_argument('package_name')
    verb.add_argument('--share', action='store_true', help='its share directory')
    verb.set_defaults(verb=prefix)


def executables(package: str) -> list[Path]:
    """Return the executable files of a package, sorted; RuntimeError if there is no such one."""
    try:
        base = Path(get_package_prefix(package)) / 'lib' / package
    except (PackageNotFoundError, ValueError):
        raise RuntimeError(f"Package '{package}' not found") from None
    files = (path for path in sorted(base.rglob('*')) if path.is_file())
    return [path for path in files if os.access(path, os.X_OK)]


def run(options: argparse.Namespace) -> int:
    """Replace this process by the executable, whose signals and exit status are then its own."""
    found = [p for p in executables(options.package_name) if p.name == options.executable_name]
    if not found:
        raise RuntimeError('No executable found')
    if len(found) > 1:
        raise RuntimeError('Multiple executables found:' + ''.join(f'\n- {p}' for p in found))
    words = [*shlex.split(options.prefix or ''), str(found[0]), *options.argv]
    try:
        os.execvp(words[0], words)
    except OSError as error:
        raise RuntimeError(f'{words[0]}: {error.strerror}') from None


def list_packages(options: argparse.Namespace) -> int:
    """Print the names of all packages."""
    for name in sorted(get_packages_with_prefixes()):
        print(name)
    return 0


def list_executables(options: argparse.Namespace) -> int:
    """Print the executables of one package or of all."""
    one = options.package_name
    for package in [one] if one else sorted(get_packages_with_prefixes()):
        for path in executables(package):
            print(path if options.full_path else f'{package} {path.name}')
    return 0


def prefix(options: argparse.Namespace) -> int:
    """Print the prefix, or the share directory, of a package."""
    find = get_package_share_directory if options.share else get_package_prefix
    try:
        print(find(options.package_name))
    except (PackageNotFoundError, ValueError):
        raise RuntimeError('Package not found') from None
    return 0
