"""Seeing a run: messages as pictures in the Rerun viewer. The only house that imports rerun, and only when asked to."""

from navloom.viewer.panels import Panel, Seen

__all__ = ["Panel", "Seen"]
