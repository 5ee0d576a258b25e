"""Monte Carlo localisation for navloom: finds a robot anywhere on a map, and tracks it.

Begin with `filter.py`, the particles; `adapter.py` makes a localizer of them and the search of `navloom_scans`.
"""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the localizer `mcl`."""
    from navloom_mcl.adapter import Mcl

    registry.add(Mcl)
