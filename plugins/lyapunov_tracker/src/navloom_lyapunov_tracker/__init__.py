"""The Lyapunov tracking law of Hoang et al. 2013 for navloom."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the controller `lyapunov_tracker`."""
    from navloom_lyapunov_tracker.adapter import LyapunovTracker

    registry.add(LyapunovTracker)
