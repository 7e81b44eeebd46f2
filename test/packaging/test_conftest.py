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

"""The fixtures find what a test leaves running."""

from __future__ import annotations

import os
import subprocess
import sys
import time

from leftovers import expect_no_leftovers, leftovers
import pytest

SLEEPER = 'import time; print(flush=True); time.sleep(60)'


def test_domain_is_in_the_environment(ros_domain: int) -> None:
    assert os.environ['ROS_DOMAIN_ID'] == str(ros_domain)
    assert 0 < ros_domain <= 101


def test_leftover_orphan_is_found_and_ended() -> None:
    code = (
        'import subprocess, sys\n'
        f"p = subprocess.Popen([sys.executable, '-c', {SLEEPER!r}], stdout=subprocess.PIPE,"
        ' stderr=subprocess.DEVNULL)\n'
        'p.stdout.readline(); print(p.pid)'
    )
    parent = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=True, timeout=30
    )
    assert int(parent.stdout) in leftovers()
    with pytest.raises(AssertionError, match='left running'):
        expect_no_leftovers()
    deadline = time.monotonic() + 10
    while leftovers():
        assert time.monotonic() < deadline
