"""A two-link flexible space robot as ROS 2 nodes in lock-step; see README.md."""
