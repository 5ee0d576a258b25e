"""The platform of an imported log: it declares its sensors for the wiring and is never driven."""

from __future__ import annotations

from importlib.metadata import EntryPoint

from navloom.entry_kinds import GROUP
from navloom.messages import RangeScan, Sweep
from navloom.plugins import Discovery
from navloom.plugins.hooks import hookimpl
from navloom.plugins.one_file import available_points
from navloom.plugins.registry import Registry
from navloom.roles import InputError, Platform, PlatformInput, PlatformOutput

from navloom_recording.imported_log import INSTANCE, RANGE_SCAN, SWEEP

__all__ = ["RecordedPlatform", "discovery", "navloom_register"]


class RecordedPlatform(Platform):
    """Placeholder for the robot of a log."""

    name = INSTANCE
    sensor_kinds = {RANGE_SCAN: RangeScan, SWEEP: Sweep}

    def advance(self, given: PlatformInput) -> PlatformOutput:
        """Raise InputError: a log cannot be driven."""
        raise InputError("the platform of an imported log cannot drive: replay it instead")


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Register the platform."""
    registry.add(RecordedPlatform)


def discovery() -> Discovery:
    """The installed plugins and this platform. It is not installed itself, as it would be offered for real robots."""
    own = EntryPoint(f"platform.{INSTANCE}", "navloom_recording.recorded_platform", GROUP)
    return Discovery((), [*available_points(), own])
