"""Completion of words in a shell, and manual pages: both made of the tree of commands."""
