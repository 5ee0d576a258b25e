"""This machine's figures beside the peers installed: `navloom bench`."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the command `bench`."""
    from navloom_benchmarks.command import bench

    registry.command("bench", bench)
