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
The frozen digests with each Python that is found, oldest and newest versions of what computes.

    .venv/bin/python -m validation.versions         # some minutes for each; needs a package index

Each combination gets a virtual environment below the temporary directory.  Exit status 1 where one
has other digests; a Python that is not there, or versions that cannot be installed, are named.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import metadata
import json
import os
from pathlib import Path
import subprocess
import sys
import tempfile

from validation.golden import frozen_digests, QUICK, ROOT

PYTHONS = ('3.10', '3.11', '3.12', '3.13')
OLDEST = '3.10'
"""The Python that the oldest versions are tried with."""

COMPUTING = ('numba', 'numpy', 'scipy')
PROGRAM = """
import json, numba, numpy, scipy
from validation.golden import digest, QUICK
print(numba.__version__, numpy.__version__, scipy.__version__)
print(json.dumps({name: digest(case) for name, case in QUICK.items()}))
"""


def requirements(oldest: bool) -> Iterator[str]:
    """Yield what the package needs; ``oldest``: the least versions of what computes."""
    for text in metadata.requires('flexarm_ros') or []:
        if 'extra ==' in text:
            continue
        name, _, least = text.partition('>=')
        yield f'{name}=={least}.*' if oldest and name in COMPUTING else text


def interpreter(version: str) -> str | None:
    """Return a working Python of this version, pyenv's included, or ``None``."""
    try:
        done = subprocess.run(
            [f'python{version}', '-c', 'import sys; print(sys._base_executable)'],
            env=os.environ | {'PYENV_VERSION': version}, capture_output=True, text=True,
        )  # fmt: skip
    except FileNotFoundError:
        return None
    return done.stdout.strip() or None


def tried(python: str, oldest: bool, directory: Path) -> str:
    """Return what came of a combination: ``the same``, or what is wrong."""
    own = directory / 'bin' / 'python'
    pip = [own, '-m', 'pip', 'install', '--quiet', '--disable-pip-version-check']
    for command in ([python, '-m', 'venv', directory], [*pip, *requirements(oldest)]):
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            return f'not installed: {done.stderr.strip().splitlines()[-1]}'
    environment = os.environ | {
        'PYTHONPATH': str(ROOT), 'NUMBA_CACHE_DIR': str(directory), 'PYTHONDONTWRITEBYTECODE': '1',
    }  # fmt: skip
    done = subprocess.run(
        [own, '-c', PROGRAM], env=environment, cwd=ROOT, capture_output=True, text=True
    )
    if done.returncode:
        return f'FAILED: {done.stderr.strip().splitlines()[-1]}'
    versions, digests = done.stdout.splitlines()
    frozen, found = frozen_digests(), json.loads(digests)
    changed = [name for name in QUICK if found[name] != frozen[name]]
    verdict = f'OTHER BYTES: {", ".join(changed)}' if changed else 'the same'
    return f'numba, numpy, scipy {versions}: {verdict}'


def main() -> int:
    """Try all combinations and say what came of each."""
    good = True
    for version, oldest in [(OLDEST, True), *((version, False) for version in PYTHONS)]:
        python = interpreter(version)
        if python is None:
            print(f'Python {version}: not found')
            continue
        with tempfile.TemporaryDirectory() as directory:
            result = tried(python, oldest, Path(directory) / 'venv')
        print(f'Python {version}, {"oldest" if oldest else "newest"}: {result}', flush=True)
        good = good and not result.startswith('FAILED') and 'OTHER' not in result
    return 0 if good else 1


if __name__ == '__main__':
    sys.exit(main())
