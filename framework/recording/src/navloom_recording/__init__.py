"""Recordings: write all messages of a robot to one MCAP file, read and replay it, and import other logs."""
