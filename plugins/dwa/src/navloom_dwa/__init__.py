"""Dynamic window approach on range sensors for navloom (Fox, Burgard & Thrun 1997), with the critics of Nav2's DWB."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the avoider `dwa`."""
    from navloom_dwa.adapter import Dwa

    registry.add(Dwa)
