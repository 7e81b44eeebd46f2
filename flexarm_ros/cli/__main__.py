"""``python -m flexarm_ros.cli``: the same as ``flexarm``."""

import sys

from flexarm_ros.cli import main

sys.exit(main())
