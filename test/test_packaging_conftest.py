"""The fixtures find what a test leaves running."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import conftest
import pytest

SLEEPER = "import time; print(flush=True); time.sleep(60)"


def test_domain_is_in_the_environment(ros_domain: int) -> None:
    assert os.environ["ROS_DOMAIN_ID"] == str(ros_domain)
    assert 0 < ros_domain <= 101


def test_leftover_orphan_is_found_and_ended() -> None:
    code = (
        "import subprocess, sys\n"
        f"p = subprocess.Popen([sys.executable, '-c', {SLEEPER!r}], stdout=subprocess.PIPE,"
        " stderr=subprocess.DEVNULL)\n"
        "p.stdout.readline(); print(p.pid)"
    )
    parent = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=30
    )
    assert int(parent.stdout) in conftest.leftovers()
    with pytest.raises(AssertionError, match="left running"):
        conftest.expect_no_leftovers()
    deadline = time.monotonic() + 10
    while conftest.leftovers():
        assert time.monotonic() < deadline
