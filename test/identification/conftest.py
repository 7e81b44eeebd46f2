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

"""Recordings of a real arm, which are no part of the repository."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from repository import ROOT


@pytest.fixture
def real() -> Path:
    """Return the directory of the recordings."""
    place = Path(os.environ.get('FLEXARM_REAL_DATA', ROOT.parent / 'shared' / 'real'))
    if not (place / 'quanser_2dsfl' / 'psf.csv').is_file():
        pytest.skip('no recordings of the real arm: set FLEXARM_REAL_DATA to their directory')
    return place / 'quanser_2dsfl'
