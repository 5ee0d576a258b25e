"""Trajectory trackers for navloom: Kanayama, Fierro-Lewis, RAMSETE, regulated pure pursuit and graceful motion."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add six controllers."""
    from navloom_trackers.adapter import FierroLewis, Graceful, Kanayama, PurePursuit, Ramsete, RegulatedPurePursuit

    for tracker in (FierroLewis, Graceful, Kanayama, PurePursuit, Ramsete, RegulatedPurePursuit):
        registry.add(tracker)
