"""Odometry from scans, matched with recently seen surfaces."""
