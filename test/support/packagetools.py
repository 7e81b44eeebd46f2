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

"""What an installation is made from."""

from __future__ import annotations

from pathlib import Path
import shutil

from repository import ROOT

SOURCES = ['flexarm_ros', 'config', 'launch', 'lib', 'resource']
FILES = ['setup.py', 'setup.cfg', 'pyproject.toml', 'package.xml', 'LICENSE', 'README.md']


def copy_sources(target: Path) -> Path:
    """Copy what an installation is made from."""
    target.mkdir(parents=True)
    for name in SOURCES:
        shutil.copytree(
            ROOT / name, target / name, ignore=shutil.ignore_patterns('__pycache__', '*.egg-info')
        )
    for name in FILES:
        if (ROOT / name).exists():
            shutil.copy(ROOT / name, target)
    return target
