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
Put into a virtual environment what ``pip install -e`` leaves out of it.

An editable install skips ``data_files``: the ament index marker, ``share`` and the executables of
``ros2 run``.  They are linked here, as ``colcon build --symlink-install`` does, so that an edited
scenario or launch file counts at once; the executables are copied, because they look for the
Python of the prefix that they are in.  Where the machine has no ``ros2`` command, the stand-in
goes into ``bin``.

Run with the environment's own Python, after ``pip install -e``.
"""

from distutils.core import run_setup  # setuptools provides it for Python 3.12 and later
import os
from pathlib import Path
import shlex
import shutil
import sys

ROOT = Path(__file__).resolve().parent.parent
PREFIX = Path(sys.prefix)

STANDIN = """#!/bin/sh
''':'
exec {python} "$0" "$@"
'''
from flexarm_ros.ros2_standin import main

raise SystemExit(main())
"""


def place(source: Path, target: Path, copy: bool) -> None:
    """Make `target` a copy of `source`, or a link to it."""
    target.parent.mkdir(parents=True, exist_ok=True)
    target.unlink(missing_ok=True)
    if copy:
        shutil.copy2(source, target)
    else:
        target.symlink_to(source)


def remove_old(directory: Path) -> None:
    """Remove what an earlier call placed in `directory`, and which may not be there any more."""
    if directory.is_dir():
        shutil.rmtree(directory)


def link_data_files() -> None:
    """Place the package's ``data_files`` below the prefix."""
    name = 'flexarm_ros'
    remove_old(PREFIX / 'share' / name)
    remove_old(PREFIX / 'lib' / name)
    for directory, files in run_setup(str(ROOT / 'setup.py'), stop_after='init').data_files:
        for file in files:
            source = ROOT / file
            place(source, PREFIX / directory / source.name, copy=directory.startswith('lib/'))


def real_ros2() -> str | None:
    """Return the path of a ``ros2`` command outside the environment, if there is one."""
    own = (PREFIX / 'bin').resolve()
    others = [p for p in os.get_exec_path() if Path(p).resolve() != own]
    return shutil.which('ros2', path=os.pathsep.join(others))


def place_standin() -> None:
    """Install the ``ros2`` stand-in, or remove it where the real one is."""
    target = PREFIX / 'bin' / 'ros2'
    if real_ros2() is not None:
        target.unlink(missing_ok=True)
        return
    target.write_text(STANDIN.format(python=shlex.quote(str(PREFIX / 'bin' / 'python'))))
    target.chmod(0o755)


if __name__ == '__main__':
    if sys.prefix == sys.base_prefix:
        sys.exit(f'{sys.executable} is not of a virtual environment')
    link_data_files()
    place_standin()
