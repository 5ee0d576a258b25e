"""IPaBD mapping for navloom: a pitched laser's 3D image pressed to a 2D map (Hoang et al. 2013)."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the mappers `ipabd` and `union`."""
    from navloom_ipabd.adapter import Ipabd, Union

    registry.add(Ipabd)
    registry.add(Union)
