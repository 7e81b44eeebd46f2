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

"""Fixtures for every test: domains of their own, and no process left behind."""

from __future__ import annotations

from collections.abc import Iterator
import os
import runpy
import subprocess
from typing import Any

import hypothesis
from leftovers import expect_no_leftovers, MARK, SESSION
import pytest
from quickstart import Popen, QuickPopen, Template
from repository import STANDIN
from strangertools import registry, site, stranger  # noqa: F401 - fixtures

# What messages tell of their publisher on other middlewares; does nothing unless it is asked to:
# ``FLEXARM_TEST_MESSAGE_INFO=none pytest -m nodes``, for one.
runpy.run_path(str(STANDIN))

# The same examples every time; `HYPOTHESIS_PROFILE=explore` draws new ones.
hypothesis.settings.register_profile('fixed', derandomize=True, deadline=None)
hypothesis.settings.register_profile('explore', deadline=None, max_examples=1000)
hypothesis.settings.load_profile(os.environ.get('HYPOTHESIS_PROFILE', 'fixed'))


@pytest.fixture(scope='session', autouse=True)
def environment(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Set what every test and every process that it starts sees."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(MARK, SESSION)
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        patch.setenv('ROS_LOG_DIR', str(tmp_path_factory.mktemp('ros_log')))
        patch.setenv('MPLBACKEND', 'Agg')
        if os.environ.get('FLEXARM_TEST_MESSAGE_INFO'):
            patch.setenv('PYTHONPATH', str(STANDIN.parent), prepend=os.pathsep)
            patch.syspath_prepend(str(STANDIN.parent))  # which `flexarm_here` gives to nodes
        patch.delenv('ROS_DOMAIN_ID', raising=False)
        QuickPopen.template = Template()
        patch.setattr(subprocess, 'Popen', QuickPopen)
        yield
        QuickPopen.template.close()


@pytest.fixture
def fresh_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every process of a test start as it does for a user; see `quickstart`."""
    monkeypatch.setattr(subprocess, 'Popen', Popen)


def pytest_itemcollected(item: pytest.Item) -> None:
    if 'essential' in item.config.getoption('markexpr') and isinstance(item, pytest.Function):
        item.fixturenames.append('fresh_processes')


@pytest.fixture
def ros_domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Reserve a ROS_DOMAIN_ID for this test, in its environment too, and see that all ends."""
    from flexarm_ros.launcher.domains import reserved_domain

    with reserved_domain() as domain:
        monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
        yield domain
        expect_no_leftovers()  # before another test may have the domain


@pytest.fixture
def rclpy_node(ros_domain: int) -> Iterator[Any]:
    """Yield a node of the test's own and its executor."""
    import rclpy

    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node('test_node', context=context)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(node)
    yield node, executor
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown(context=context)


@pytest.fixture(scope='module', autouse=True)
def no_leftovers() -> Iterator[None]:
    """Fail the module that leaves a process running."""
    yield
    expect_no_leftovers()
