"""Command of the viewer."""
