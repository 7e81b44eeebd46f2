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

"""Where the repository is, so that a test file can move without losing it."""

from __future__ import annotations

from pathlib import Path

ROOT = next(path for path in Path(__file__).resolve().parents if (path / 'setup.py').exists())
TESTS = ROOT / 'test'
SUPPORT = Path(__file__).resolve().parent
PATH = f'{SUPPORT}:{SUPPORT}/nodes:{SUPPORT}/bags:{ROOT}'
"""``PYTHONPATH`` of a process that imports the package and the helpers of the tests."""
STANDIN = TESTS / 'message_info' / 'sitecustomize.py'
"""Takes away what messages tell of their publisher, as other middlewares do."""
