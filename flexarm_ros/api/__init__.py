"""What notebooks and scripts use: runs, pictures, linear models, an environment for learning.

The outermost layer beside the command line; ROS is not needed.  Use the names through
``import flexarm_ros as fa``; those listed in ``flexarm_ros.__all__`` are stable.
"""
