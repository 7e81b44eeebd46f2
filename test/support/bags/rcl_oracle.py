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

"""What real rcl reads from a parameter file: the oracle of the scenario reader's tests."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.node import Node

OWN = ('use_sim_time', 'start_type_description_service')


class RclError(Exception):
    """rcl refused the file."""


def read(text: str, directory: Path, node: str = 'plant') -> dict[str, Any]:
    """Return the parameters that a node gets from ``text`` as ``--params-file``."""
    path = directory / 'oracle.yaml'
    path.write_bytes(text.encode())
    return resolve([path], f'/{node}')


def resolve(files: Sequence[Path], name: str) -> dict[str, Any]:
    """Return the parameters that the node of that fully qualified name gets from ``files``."""
    context = Context()
    words = [word for file in files for word in ('--params-file', str(file))]
    try:
        rclpy.init(args=['--ros-args', *words], context=context)
    except Exception as error:
        raise RclError(str(error)) from None
    try:
        namespace, _, node = name.rpartition('/')
        made = Node(
            node,
            namespace=namespace,
            context=context,
            automatically_declare_parameters_from_overrides=True,
            enable_rosout=False,
            start_parameter_services=False,
        )
        found = {name: made.get_parameter(name).value for name in made._parameters}
        made.destroy_node()
    finally:
        rclpy.shutdown(context=context)
    return {key: _plain(value) for key, value in found.items() if key not in OWN}


def _plain(value: Any) -> Any:
    return list(value) if hasattr(value, 'typecode') or isinstance(value, (list, tuple)) else value
