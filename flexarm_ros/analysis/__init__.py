"""Recorded runs looked at: pictures, reports, comparisons.  Never imports rclpy."""
