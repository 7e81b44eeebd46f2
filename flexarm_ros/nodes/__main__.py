"""``python -m flexarm_ros.nodes NAME --ros-args ...``."""

import sys

from flexarm_ros.nodes import main

if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1].startswith("-"):
        print("usage: python -m flexarm_ros.nodes NAME [--ros-args ...]", file=sys.stderr)
        sys.exit(2)
    sys.exit(main(sys.argv[1], sys.argv[2:]))
