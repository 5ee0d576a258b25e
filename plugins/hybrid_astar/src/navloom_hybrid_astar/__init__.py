"""Hybrid A*: drivable paths for long, asymmetric and car-like robots.

Begin with `planning.py`, which joins the steps: `flood.py` and `curves.py` are the heuristics, `clearance.py` tests the
footprint, `search.py` searches, `smoothing.py` shortens.
"""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the planner `hybrid_astar`."""
    from navloom_hybrid_astar.adapter import HybridAstar

    registry.add(HybridAstar)
