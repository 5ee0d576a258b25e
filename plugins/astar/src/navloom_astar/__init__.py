"""Optimal 8-connected grid planning for navloom: A* without corner cutting."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the planner `astar`."""
    from navloom_astar.adapter import AStar

    registry.add(AStar)
