"""Monte Carlo localisation for navloom: finds a robot anywhere on a map, and tracks it.

Begin with `filter.py`, the particles; `adapter.py` makes a localizer of them and the search of `navloom_scans`.
"""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the localizers `mcl` and `global_matching`."""
    from navloom_mcl.adapter import Mcl
    from navloom_mcl.global_matching.adapter import GlobalMatching

    registry.add(Mcl)
    registry.add(GlobalMatching)
