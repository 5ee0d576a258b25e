"""Messages as pictures, in Rerun or Foxglove, drawn in a process of their own so that no robot waits.

Begin with `viewer_session.py`: a viewer and the drawing process for one run; `bridge.py` is the queue between them.
`builtin_panels.py` lists how each message is drawn; `panels.py` is public, and plugins add theirs by the same hook.
Only this distribution imports rerun, and only when a viewer is requested.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from navloom.parts import lazy_names

if TYPE_CHECKING:
    from navloom_viewer.panels import Change as Change
    from navloom_viewer.panels import Drawn as Drawn
    from navloom_viewer.panels import Panel as Panel
    from navloom_viewer.panels import Seen as Seen
    from navloom_viewer.picture_setup import SweepRule as SweepRule
    from navloom_viewer.picture_setup import sweep_rule as sweep_rule
    from navloom_viewer.sweep_classes import CLASSES as CLASSES
    from navloom_viewer.sweep_classes import KEPT as KEPT
    from navloom_viewer.sweep_classes import classify_sweep as classify_sweep
else:
    __all__, __getattr__ = lazy_names(
        "navloom_viewer",
        {
            "navloom_viewer.picture_setup": "SweepRule sweep_rule",
            "navloom_viewer.panels": "Change Drawn Panel Seen",
            "navloom_viewer.sweep_classes": "CLASSES KEPT classify_sweep",
        },
    )
