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

"""The option ``--namespace``: one namespace for all names of a run."""

from __future__ import annotations

import argparse

from flexarm_ros.cli import UsageError


def add_option(parser: argparse.ArgumentParser, what: str) -> None:
    """Add ``--namespace``; ``what`` describes its content."""
    parser.add_argument('--namespace', default='', metavar='NS', help=what)


def checked(text: str, option: str = '--namespace ') -> str:
    """
    Return a namespace as ``/left``, empty for none; the leading slash is optional.

    Raises UsageError, prefixed by ``option``, if ROS 2 does not allow the name.
    """
    from rclpy.exceptions import InvalidNamespaceException
    from rclpy.validate_namespace import validate_namespace

    if text in ('', '/'):
        return ''
    name = text if text.startswith('/') else f'/{text}'
    try:
        validate_namespace(name)
        name.encode()
    except (InvalidNamespaceException, ValueError) as error:
        reason = str(error).splitlines()[0].removeprefix('Invalid namespace: ').rstrip(':')
        raise UsageError(f'{option}{text}: not a namespace: {reason}') from None
    return name
