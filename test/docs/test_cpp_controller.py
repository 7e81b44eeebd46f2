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
"""The controller in C++: in step with the protocol, and built and flown where rclcpp is."""

from __future__ import annotations

import os
from pathlib import Path
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET

from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.signals import JOINTS
from flexarm_ros.wire.topics import per_tick_topics
from nodetools import flexarm, ROOT
import pytest

EXAMPLE = ROOT / 'examples' / 'cpp_controller'
PYTHON = ROOT / 'examples' / 'minimal_controller.py'
SOURCE = (EXAMPLE / 'src' / 'controller.cpp').read_text()
ENDPOINT = re.compile(r'create_(publisher|subscription)<(\w+)>\(\s*"([^"]+)",\s*(\w+)')


def test_its_topics_are_those_of_the_protocol() -> None:
    topics = {topic.name: topic for topic in per_tick_topics(RunConfig())}
    page = (ROOT / 'docs' / 'protocol.md').read_text()
    found = ENDPOINT.findall(SOURCE)
    assert {(kind, name) for kind, _, name, _ in found} == {
        ('publisher', 'joint_command'), ('subscription', 'plant/state'),
    }  # fmt: skip
    (using,) = re.findall(r'using (\w+)::msg::(\w+);', SOURCE)
    (depth,) = re.findall(r'const auto qos = rclcpp::QoS\(rclcpp::KeepLast\((\d+)\)\)\.(\w+)\(\)',
                          SOURCE)  # fmt: skip
    for _, kind, name, qos in found:
        topic = topics[name]
        assert topic.type_name == f'{using[0]}/msg/{kind}' and kind == using[1]
        assert f'| `{name}` | {using[0]}/{kind} |' in page
        assert (qos, int(depth[0]), depth[1]) == ('qos', topic.qos.depth, topic.qos.reliability)
    assert f'keep last {depth[0]}' in page
    assert set(re.findall(r'"(shoulder|elbow)"', SOURCE)) == set(JOINTS)


def test_its_law_is_that_of_the_example_in_python() -> None:
    call = r'torque\(state, "(\w+)", ([^,]+), ([^,]+), ([^,)]+)\)'
    joints, *numbers = zip(*re.findall(call, SOURCE), strict=True)
    assert joints == JOINTS
    goal, kp, kd = (', '.join(each).replace('M_PI', 'math.pi') for each in numbers)
    law = PYTHON.read_text()
    assert f'\nGOAL = ({goal})\nKP, KD = ({kp}), ({kd})\n' in law


def test_it_is_a_package_like_any_other() -> None:
    manifest = ET.parse(EXAMPLE / 'package.xml').getroot()
    needs = {entry.text for entry in manifest if entry.tag.endswith('depend')}
    lists = (EXAMPLE / 'CMakeLists.txt').read_text()
    assert set(re.findall(r'find_package\((\w+) REQUIRED\)', lists)) == needs
    assert f'project({manifest.findtext("name")})' in lists
    included = set(re.findall(r'#include "(\w+)/', SOURCE))
    assert included == needs - {'ament_cmake'}
    code = [line for line in SOURCE.splitlines() if line and not line.startswith('//')]
    assert len(code) <= 60


def rclcpp_prefix() -> Path | None:
    """Return the prefix that rclcpp is installed in, None without it."""
    for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep):
        if prefix and (Path(prefix) / 'share/rclcpp/cmake/rclcppConfig.cmake').is_file():
            return Path(prefix)
    return None


@pytest.mark.nodes
@pytest.mark.skipif(
    rclcpp_prefix() is None or shutil.which('cmake') is None,
    reason='rclcpp (source a ROS 2 installation) or cmake is not installed',
)
def test_it_is_built_and_flown(tmp_path: Path, ros_domain: int) -> None:
    build = tmp_path / 'build'
    for words in (('-S', str(EXAMPLE), '-B', str(build)), ('--build', str(build))):
        subprocess.run(['cmake', *words], check=True, timeout=300)
    same = f'{sys.executable} {PYTHON}'
    for name, controller, words in (
        ('processes', build / 'controller', ()),
        ('python', same, ('--compose',)),
        ('free', build / 'controller', ('--set', 'sync=free', '--set', 'control_period=0.005')),
    ):
        done = flexarm(
            'run', 'pd_tip', '--node', f'controller={controller}', '--set', 'duration=0.5',
            '--no-pictures', '--out', tmp_path / name, *words,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert flexarm('verify', tmp_path / name).returncode == 0
    bags = [tmp_path / name / 'bag' / 'bag_0.mcap' for name in ('processes', 'python')]
    assert bags[0].read_bytes() == bags[1].read_bytes()
