"""Executors of the graph."""
