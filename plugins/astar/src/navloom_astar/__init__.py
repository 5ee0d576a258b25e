"""Optimal 8-connected grid planning for navloom: A*, Dijkstra and jump point search, without corner cutting."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the planners `astar`, `dijkstra` and `jps`."""
    from navloom_astar.adapter import AStar, Dijkstra, JumpPoint

    for planner in (AStar, Dijkstra, JumpPoint):
        registry.add(planner)
