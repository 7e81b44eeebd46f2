"""Physics, sensors and control of the arm: pure functions of numbers.

Nothing below this package imports rclpy, opens a file, reads a clock or draws
from a global random generator.
"""
