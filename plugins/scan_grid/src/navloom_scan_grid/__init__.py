"""Log-odds occupancy grid from 2D lasers and sonars for navloom (Moravec & Elfes 1985, Thrun et al. 2005)."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the mappers `scan_grid` and `layered`."""
    from navloom_scan_grid.adapter import Layered, ScanGrid

    registry.add(ScanGrid)
    registry.add(Layered)
