"""The command `navloom bench`: measures navloom and other installed software (*peers*) in turn, on this machine."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Register the command `bench`."""
    from navloom_benchmarks.command import bench

    registry.command("bench", bench)
