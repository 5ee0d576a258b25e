"""Reproduction of the experiment of Hoang et al. 2013: `navloom paper`."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the command `paper`."""
    from navloom_hoang2013.command import paper

    registry.command("paper", paper)
