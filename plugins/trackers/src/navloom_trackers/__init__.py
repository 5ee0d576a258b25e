"""Trajectory trackers for navloom: Kanayama, Fierro-Lewis, RAMSETE and regulated pure pursuit."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the controllers `fierro_lewis`, `kanayama`, `pure_pursuit` and `ramsete`."""
    from navloom_trackers.adapter import FierroLewis, Kanayama, PurePursuit, Ramsete

    for tracker in (FierroLewis, Kanayama, PurePursuit, Ramsete):
        registry.add(tracker)
