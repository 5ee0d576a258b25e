"""Scan matching against a known map for navloom."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the localizer `scan_matching`."""
    from navloom_scan_localizer.adapter import ScanMatching

    registry.add(ScanMatching)
