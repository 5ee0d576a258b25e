"""The command line: one file a command, everything heavy imported when a command runs."""

from navloom.cli.main import main

__all__ = ["main"]
