"""A very small ``ros2`` command for environments that have rclpy from wheels and nothing more.

ros2cli is not packaged as wheels, so that ``ros2 run`` and the look-ups that people type first
would be missing from a virtual environment.  This has those few, with the names, options, output
and exit statuses of the real command, and gives way to the real one wherever that is on ``PATH``.

It uses nothing of the rest of the package, and nothing of the package uses it.
"""

from flexarm_ros.ros2_standin.frame import main

__all__ = ["main"]
