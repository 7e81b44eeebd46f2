"""Scenarios: ROS 2 parameter files read, checked and written without ROS."""

from flexarm_ros.scenario.errors import ScenarioError
from flexarm_ros.scenario.locate import find, shipped, shipped_suites, shipped_sweeps
from flexarm_ros.scenario.reader import from_dict, from_text, load, with_values
from flexarm_ros.scenario.torque_file import read_torques, write_torques
from flexarm_ros.scenario.writer import dump, resolved, to_dict

__all__ = [
    "ScenarioError",
    "dump",
    "find",
    "from_dict",
    "from_text",
    "load",
    "read_torques",
    "resolved",
    "shipped",
    "shipped_suites",
    "shipped_sweeps",
    "to_dict",
    "with_values",
    "write_torques",
]
