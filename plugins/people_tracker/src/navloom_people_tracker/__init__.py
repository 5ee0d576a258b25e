"""Tracks of people and other moving bodies from the robot's own laser scans."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the node `people_tracker`."""
    from navloom_people_tracker.adapter import PeopleTracker

    registry.node(PeopleTracker)
