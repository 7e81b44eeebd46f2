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

"""What a wheel carries, and that it works where nothing else of the tree is."""

from __future__ import annotations

import ast
from importlib.metadata import packages_distributions
from pathlib import Path
import subprocess
import sys
import sysconfig
import venv
import xml.etree.ElementTree as ET
import zipfile

from layertools import imports, modules, ROS
from nodetools import EXECUTABLES
from packagetools import copy_sources
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
import pytest
from repository import ROOT


@pytest.fixture(scope='module')
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the wheel from a copy of the sources."""
    root = copy_sources(tmp_path_factory.mktemp('wheel') / 'source')
    pip = [sys.executable, '-m', 'pip', '--disable-pip-version-check']
    out = root.parent / 'out'
    command = [*pip, 'wheel', '--quiet', '--no-deps', '--no-build-isolation', '-w', out, root]
    built = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert built.returncode == 0, built.stderr
    (found,) = out.glob('*.whl')
    return found


@pytest.fixture(scope='module')
def prefix(wheel: Path) -> Path:
    """Install the wheel into an environment of its own, which borrows the dependencies."""
    root = wheel.parent.parent / 'venv'
    venv.create(root, symlinks=True)
    subprocess.run(
        [sys.executable, '-m', 'pip', 'install', '--quiet', '--no-deps', '--no-index']
        + ['--ignore-installed', '--disable-pip-version-check', '--prefix', root, wheel],
        check=True,
        timeout=120,
    )
    libraries = root / 'lib' / f'python{sys.version_info[0]}.{sys.version_info[1]}/site-packages'
    borrowed = {sysconfig.get_path('purelib'), sysconfig.get_path('platlib')}
    (libraries / 'borrowed.pth').write_text('\n'.join(sorted(borrowed)))
    return root


def run(command: list[object], cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(word) for word in command], cwd=cwd, capture_output=True, text=True, timeout=60
    )


def test_wheel_carries_what_ros_looks_for(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        entries = {entry.filename: entry for entry in archive.infolist()}
    data = {
        name.split('.data/data/')[1]: entry
        for name, entry in entries.items()
        if '.data/data/' in name
    }
    share = 'share/flexarm_ros'
    expected = {
        'share/ament_index/resource_index/packages/flexarm_ros',
        f'{share}/package.xml',
        *(f'{share}/launch/{name}.launch.py' for name in ('run', 'view')),
        *(f'{share}/{path.relative_to(ROOT)}' for path in (ROOT / 'config').rglob('*.*')),
        *(f'lib/flexarm_ros/{name}' for name in EXECUTABLES),
    }
    assert expected == set(data)
    for name in EXECUTABLES:
        assert data[f'lib/flexarm_ros/{name}'].external_attr >> 16 & 0o111


def test_wheel_carries_the_whole_package(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        carried = {name for name in archive.namelist() if name.startswith('flexarm_ros/')}
    inside = {
        str(path.relative_to(ROOT))
        for path in (ROOT / 'flexarm_ros').rglob('*')
        if path.is_file() and '__pycache__' not in path.parts
    }
    assert inside - carried == set()


def test_installed_wheel_finds_its_scenarios(prefix: Path, tmp_path: Path) -> None:
    done = run([prefix / 'bin' / 'flexarm', 'list'], tmp_path)
    assert done.returncode == 0, done.stderr
    listed = {line.split()[0] for line in done.stdout.splitlines() if line.strip()}
    assert {path.stem for path in (ROOT / 'config').glob('*.yaml')} <= listed


def test_executables_run_on_the_python_of_their_prefix(prefix: Path, tmp_path: Path) -> None:
    """Three of them: all are the same file, as test_env.py has it."""
    bad = tmp_path / 'bad.yaml'
    bad.write_text('/**:\n  ros__parameters:\n    no_such_key: 1\n')
    further = {'node': ['encoder']}  # `node` takes the role
    processes = {
        name: subprocess.Popen(
            [
                prefix / 'lib/flexarm_ros' / name,
                *further.get(name, []),
                '--ros-args',
                '--params-file',
                bad,
            ],
            cwd=tmp_path,
            stderr=subprocess.PIPE,
            text=True,
        )
        for name in ('plant', 'strain_gauge', 'node')
    }
    for name, process in processes.items():
        _, said = process.communicate(timeout=60)
        assert process.returncode == 2, said
        assert said.startswith(f'{further.get(name, [name])[0]}: '), said
        assert 'no_such_key' in said
        assert 'Traceback' not in said


def test_executable_imports_the_installed_package(prefix: Path, tmp_path: Path) -> None:
    code = 'import flexarm_ros; print(flexarm_ros.__file__)'
    done = run([prefix / 'bin' / 'python', '-c', code], tmp_path)
    assert done.stdout.startswith(str(prefix))


def test_pkg_look_ups_find_the_installed_wheel(prefix: Path, tmp_path: Path) -> None:
    standin = [prefix / 'bin' / 'python', '-m', 'flexarm_ros.ros2_standin']
    listed = run([*standin, 'pkg', 'executables', 'flexarm_ros'], tmp_path)
    assert {line.split()[1] for line in listed.stdout.splitlines()} == EXECUTABLES
    assert run([*standin, 'pkg', 'prefix', 'flexarm_ros'], tmp_path).stdout.strip() == str(prefix)


def test_package_xml_agrees_with_setup() -> None:
    root = ET.parse(ROOT / 'package.xml').getroot()
    setup = run([sys.executable, 'setup.py', '--name', '--version', '--license'], ROOT)
    name, version, license_ = setup.stdout.split()[-3:]
    assert (root.findtext('name'), root.findtext('version')) == (name, version)
    assert root.findtext('license') == license_
    assert root.findtext('export/build_type') == 'ament_python'
    (maintainer,) = root.findall('maintainer')
    # The form that catkin_pkg accepts; for any other, colcon takes this for plain Python.
    address, _, host = maintainer.attrib['email'].partition('@')
    assert address
    assert 2 <= len(host.rpartition('.')[2]) <= 6


def imported() -> set[str]:
    """Return the top-level names of everything that the package imports."""
    names: set[str] = set()
    for path in modules():
        names |= {name.split('.')[0] for name in imports(ast.parse(path.read_text()), '', False)}
    return {name for name in names if name and name != 'flexarm_ros'}


def is_ros(name: str) -> bool:
    return name in ROS or name.endswith(('_msgs', '_interfaces', '_srvs'))


def test_package_xml_names_the_ros_packages_that_are_imported() -> None:
    named = {element.text for element in ET.parse(ROOT / 'package.xml').getroot()}
    optional = {'simulation_interfaces'}
    assert {name for name in imported() if is_ros(name)} <= named | optional


def test_requirements_name_the_libraries_that_are_imported(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        (metadata,) = (n for n in archive.namelist() if n.endswith('.dist-info/METADATA'))
        lines = archive.read(metadata).decode().splitlines()
    requirements = [Requirement(line[15:]) for line in lines if line.startswith('Requires-Dist: ')]
    required = {canonicalize_name(requirement.name) for requirement in requirements}
    # Python 3.10 knows only the modules that a distribution lists in a file of setuptools.
    distributions = {'mpl_toolkits': ['matplotlib'], **packages_distributions()}
    missing = {
        name
        for name in imported()
        if not is_ros(name)
        and name not in sys.stdlib_module_names
        and required.isdisjoint(map(canonicalize_name, distributions.get(name, [name])))
    }
    assert missing == set()
