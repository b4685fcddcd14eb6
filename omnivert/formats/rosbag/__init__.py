"""Bags of ROS, read and written without ROS."""
