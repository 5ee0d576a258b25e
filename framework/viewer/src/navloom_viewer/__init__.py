"""Shows runs in the Rerun viewer. Only this house imports rerun, and only when a viewer is requested."""

from navloom_viewer.panels import Panel, Seen

__all__ = ["Panel", "Seen"]
