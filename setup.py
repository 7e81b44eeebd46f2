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

"""Install flexarm_ros: by pip with or without an ament index around it, and by colcon."""

import gzip
import os
from pathlib import Path
import tarfile

from setuptools import find_packages, setup
from setuptools.command.sdist import sdist

PACKAGE = 'flexarm_ros'
# Not resolved: `colcon build --symlink-install` links this file into a build directory, where the
# metadata that `flexarm` is found by must be made.
ROOT = Path(__file__).absolute().parent
os.chdir(ROOT)


def files(pattern):
    """Return the files that match below the root, sorted, as paths relative to it."""
    found = (path for path in ROOT.glob(pattern) if path.is_file())
    return sorted(str(path.relative_to(ROOT)) for path in found if path.suffix != '.pyc')


def package_files():
    """Return the files inside the package that are not Python, relative to the package."""
    found = files(f'{PACKAGE}/py.typed') + files(f'{PACKAGE}/**/assets/**/*')
    return [str(Path(name).relative_to(PACKAGE)) for name in found]


def shared_files():
    """Return ``data_files``: what ROS 2 tools look for outside the Python package."""
    share = f'share/{PACKAGE}'
    groups = [
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (share, ['package.xml']),
        (f'{share}/config', files('config/*')),
        (f'{share}/config/rosbag2', files('config/rosbag2/*')),
        (f'{share}/launch', files('launch/*.py')),
        # The executables that `ros2 run` lists. They are data files rather than console scripts
        # because pip puts console scripts into bin only, and `ros2 run` does not look there.
        (f'lib/{PACKAGE}', files(f'lib/{PACKAGE}/*')),
    ]
    return [(directory, names) for directory, names in groups if names]


class ReproducibleSdist(sdist):
    """An sdist of the same sources has the same bytes, as a wheel has by SOURCE_DATE_EPOCH."""

    def make_archive(
        self, base_name, format, root_dir=None, base_dir=None, owner=None, group=None
    ):
        """Write a .tar.gz with files in order, one time stamp and no user; return its path."""
        if format != 'gztar':
            return super().make_archive(base_name, format, root_dir, base_dir, owner, group)
        epoch, path = int(os.environ['SOURCE_DATE_EPOCH']), f'{base_name}.tar.gz'

        def plain(member):
            member.mtime, member.uid, member.gid, member.uname, member.gname = epoch, 0, 0, '', ''
            member.mode = 0o755 if member.isdir() or member.mode & 0o100 else 0o644
            return member

        os.makedirs(os.path.dirname(path), exist_ok=True)
        with (
            open(path, 'wb') as raw,
            gzip.GzipFile('', 'wb', mtime=epoch, fileobj=raw) as packed,
            tarfile.open(fileobj=packed, mode='w', format=tarfile.PAX_FORMAT) as archive,
        ):
            archive.add(base_dir, filter=plain)  # in order of name
        return path


# The ZIP format, and so a wheel, knows no earlier time.
os.environ.setdefault('SOURCE_DATE_EPOCH', '315532800')

REQUIREMENTS = [
    'PyYAML',
    'llvmlite',  # numba's compiler: the calls of rcl in compiled code are made with it
    'lz4',
    'matplotlib>=3.5',
    'mcap',
    'networkx',  # imported by skfuzzy.control
    'numba>=0.57',
    'numpy>=1.22',
    'orjson',  # trajectory.csv; without it the same text takes longer
    'rich',
    'rosbags>=0.11',  # reads single .db3 files
    'scikit-fuzzy>=0.5',
    'scipy>=1.8',
    'zstandard',
]

# Sphinx with Markdown pages; latex2mathml turns formulas into MathML, so that no page needs a
# script from elsewhere.
DOCS = ['furo', 'latex2mathml', 'myst-parser', 'sphinx']
# What `import flexarm_ros` can hand its results to.
GYMNASIUM = 'gymnasium>=1.0'
NOTEBOOK = ['control', GYMNASIUM, 'ipykernel', 'nbclient', 'pandas', 'xarray']

# The live view: the WebSocket server that Foxglove and Lichtblick connect to.
VIEW = ['foxglove-sdk']

EXTRAS = {
    # rclpy and the messages as wheels, for a machine without a ROS 2 install.
    'ros': ['ros-rclpy[fastrtps]>=7.1', 'ros-common-interfaces'],
    'dev': [
        # Another multibody code, in tests and `make validate` only; it has wheels for these alone.
        "exudyn; platform_machine == 'x86_64' and python_version < '3.14'",
        'build',  # the tests build the sdist and the wheel twice
        'colcon-common-extensions',  # the tests install the package as a full ROS 2 does
        'distributed',  # else the test of a Dask cluster is skipped
        'hypothesis',
        'mcap-ros2-support',  # reads our bags in tests
        'mpmath',  # true values of sines and logarithms, in tests
        'mypy',
        'pyarrow',  # else the tests of Parquet files are skipped
        'pytest',
        'pytest-xdist',  # `make test` runs two tests at once
        'ruff',
        'twine',  # checks them
        'types-PyYAML',
        'uv',  # `make lock`, and the environments of `make pythons`
        *VIEW,
        'websockets',  # a browser's side of the live view, in tests
    ],
    # By this name `colcon test` recognises that pytest is to run.
    'test': ['hypothesis', 'mcap-ros2-support', 'mpmath', 'pytest'],
    'docs': DOCS,
    'view': VIEW,
    'notebook': NOTEBOOK,
    'pandas': ['pandas'],
    'xarray': ['xarray'],
    'control': ['control'],
    'gymnasium': [GYMNASIUM],
    'dask': ['distributed'],
    'parquet': ['pyarrow'],
    'colcon': ['colcon-common-extensions'],
}

setup(
    name=PACKAGE,
    version='0.1.0',
    description='A two-link flexible arm as ROS 2 nodes in lock-step: plant, sensors, control.',
    long_description=(ROOT / 'README.md').read_text('utf-8')
    if (ROOT / 'README.md').is_file()
    else '',
    long_description_content_type='text/markdown',
    license='Apache-2.0',
    maintainer='The flexarm_ros maintainers',
    maintainer_email='maintainers@example.org',
    classifiers=[f'Programming Language :: Python :: 3.{minor}' for minor in (10, 11, 12, 13)],
    keywords=['ROS', 'control', 'flexible manipulator', 'simulation'],
    python_requires='>=3.10',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={PACKAGE: package_files()},
    data_files=shared_files(),
    install_requires=REQUIREMENTS,
    extras_require=EXTRAS,
    entry_points={
        'console_scripts': ['flexarm = flexarm_ros.cli:main'],
        'pytest11': ['flexarm = flexarm_ros.launcher.pytest_plugin'],
    },
    zip_safe=False,
    cmdclass={'sdist': ReproducibleSdist},
)
