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

"""The definitions in a file are those of the type store, for every topic of this package."""

from __future__ import annotations

from pathlib import Path
import subprocess
import sys

from flexarm_ros import scenario
from flexarm_ros.bag import definitions
from flexarm_ros.scenario.locate import shipped
from flexarm_ros.wire import parameter_event
from flexarm_ros.wire.topics import per_tick_topics
import pytest

COMMAND = 'python -m flexarm_ros.bag.definitions'


@pytest.mark.parametrize('type_name', sorted(definitions.kept()))
def test_the_file_has_what_the_store_has(type_name: str) -> None:
    """Text and hash are those of the type store."""
    assert definitions.definition(type_name) == definitions.from_store(type_name), (
        f'run: {COMMAND}'
    )


def test_the_file_has_every_type_of_the_shipped_scenarios() -> None:
    """No topic of a shipped scenario, nor a parameter change, needs the type store."""
    needed = {parameter_event.TYPE}
    for name in shipped():
        needed |= {topic.type_name for topic in per_tick_topics(scenario.load(name))}
    missing = sorted(needed - definitions.kept().keys())
    assert not missing, f'run: {COMMAND} {" ".join(missing)}'


def test_a_type_outside_the_file_is_taken_from_the_store() -> None:
    """The part of another package may have another type."""
    name = 'std_msgs/msg/Float64'
    assert name not in definitions.kept()
    assert 'float64 data' in definitions.definition(name).text


def test_a_recorded_simulation_does_not_import_the_store(tmp_path: Path) -> None:
    """It takes 0.2 s."""
    program = (
        'import sys; from flexarm_ros.cli import main; '
        'main(["simulate", "fls_tip", "--set", "duration=0.001", "--no-pictures", "--out", '
        f'{str(tmp_path / "run")!r}]); print([n for n in sys.modules if "rosbags" in n])'
    )
    done = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == '[]', done.stderr
