"""Command of the checks."""
