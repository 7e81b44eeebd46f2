"""``python -m flexarm_ros.ros2_standin``."""

from flexarm_ros.ros2_standin import main

raise SystemExit(main())
