"""Recordings: every message of a robot in one MCAP file, read again, replayed node by node, or made from other logs."""
