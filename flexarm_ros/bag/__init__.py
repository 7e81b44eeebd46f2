"""Bags: message codecs, MCAP writing and reading, CSV and summary.  Never imports rclpy."""
