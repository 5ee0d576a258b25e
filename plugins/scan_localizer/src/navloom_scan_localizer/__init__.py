"""Scan matching for navloom: against a known map, or against recently seen surfaces."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the localizers `scan_matching` and `scan_odometry`."""
    from navloom_scan_localizer.adapter import ScanMatching
    from navloom_scan_localizer.scan_odometry.adapter import ScanOdometry

    registry.add(ScanMatching)
    registry.add(ScanOdometry)
