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

"""A run's bytes depend on no processor, C library, BLAS, or dispatch of NumPy's."""

from __future__ import annotations

import os
from pathlib import Path
import re
import subprocess
import sys

from nodetools import flexarm_here
import numpy as np
import pytest
from repository import ROOT
from validation import golden

try:
    from numpy._core import _multiarray_umath as umath
except ImportError:  # NumPy 1
    from numpy.core import _multiarray_umath as umath  # type: ignore[no-redef]

PROGRAM = (
    'import sys\n'
    'from validation import golden\n'
    'for name in sys.argv[1:]:\n'
    '    print(golden.digest(golden.QUICK[name]))\n'
)
# What numpy would use of this processor beyond its baseline.
DISPATCHED = [name for name in umath.__cpu_dispatch__ if umath.__cpu_features__[name]]
# Both spellings, of glibc before and from 2.33 on.
NAMES = ('AVX2', 'FMA', 'FMA4', 'AVX512F', 'AVX2_Usable', 'FMA_Usable', 'FMA4_Usable')
OLD_PROCESSOR = {'GLIBC_TUNABLES': f'glibc.cpu.hwcaps={",".join(f"-{name}" for name in NAMES)}'}
QUICK_ONES = ('fls_tip', 'full_three_modes', 'noise', 'pade2', 'lqg')
BLAS = [{'OPENBLAS_CORETYPE': kind} for kind in ('Prescott', 'Haswell')]  # Zen has Haswell's


def under(environment: dict[str, str], *arguments: str) -> list[str]:
    """Return the lines that a Python process prints in this environment."""
    done = subprocess.run(
        [sys.executable, *arguments], env=os.environ | environment, cwd=ROOT,
        capture_output=True, text=True, check=True, timeout=600,
    )  # fmt: skip
    return done.stdout.split()


def check(environment: dict[str, str], names: tuple[str, ...]) -> None:
    frozen = golden.frozen_digests()
    found = under(environment, '-c', PROGRAM, *names)
    assert dict(zip(names, found, strict=True)) == {name: frozen[name] for name in names}


@pytest.mark.parametrize(
    'environment',
    [OLD_PROCESSOR, *BLAS, {'NPY_DISABLE_CPU_FEATURES': ' '.join(DISPATCHED)}],
    ids=lambda environment: ' '.join(environment) + '=' + str(*environment.values())[:24],
)
def test_library_code_for_other_processors(environment: dict[str, str]) -> None:
    check(environment, QUICK_ONES)


def test_the_c_library_gives_other_sines_there() -> None:
    """Else the test with GLIBC_TUNABLES would show nothing on this machine."""
    sines = 'import math; print(sum(hash(math.sin(0.01 * k)) for k in range(100000)))'
    if under({}, '-c', sines) == under(OLD_PROCESSOR, '-c', sines):
        pytest.skip('this C library has one sine for all processors')


def test_our_code_for_another_processor() -> None:
    check({'NUMBA_CPU_NAME': 'generic'}, ('fls_tip', 'noise'))


@pytest.mark.slow
def test_all_our_code_for_another_processor() -> None:
    check({'NUMBA_CPU_NAME': 'generic'} | OLD_PROCESSOR, tuple(golden.QUICK))


SHORT = ('fls_tip', 'duration=0.2')
INTERPRETED = (
    SHORT,
    ('pd_tip', 'duration=0.1', 'tip_sensor.latency_model=pade2', 'encoder.noise_std=1e-4'),
    ('pd_full', 'duration=0.02', 'plant.modes=2', 'plant.basis=craig_bampton'),
)


def flown(directory: Path, scenario: str, settings: tuple[str, ...], **environment: str) -> str:
    """Return the digest of a run of the command line's, in a process of its own if need be."""
    sets = [word for setting in settings for word in ('--set', setting)]
    words = ['simulate', scenario, *sets, '--no-pictures', '--out', str(directory)]
    if environment:
        under(environment, '-m', 'flexarm_ros.cli', *words)
    else:
        assert flexarm_here(*words).returncode == 0
    return str(flexarm_here('digest', directory).stdout.strip())


@pytest.mark.parametrize('case', INTERPRETED, ids=lambda case: case[0])
def test_interpreted_code(case: tuple[str, ...], tmp_path: Path) -> None:
    name, *settings = case
    digest = flown(tmp_path / 'compiled', name, tuple(settings))
    assert re.fullmatch('[0-9a-f]{64}', digest)
    assert flown(tmp_path / 'not', name, tuple(settings), NUMBA_DISABLE_JIT='1') == digest


def test_a_digest_is_of_the_messages_alone(tmp_path: Path) -> None:
    digest = flown(tmp_path / 'a', 'fls_tip', ('duration=0.2',))
    settings = ('duration=0.2', 'recorder.compression=none', 'recorder.chunk_time=0.05')
    assert flown(tmp_path / 'b', 'fls_tip', settings) == digest
    other = float(np.nextafter(150.79, 200.0))
    assert flown(tmp_path / 'c', 'fls_tip', ('duration=0.2', f'controller.kp={other!r}')) != digest
