"""The platform of an imported log: it gives its sensors to the wiring, and is never asked to move."""

from __future__ import annotations

from importlib.metadata import EntryPoint

from navloom.entry_kinds import GROUP
from navloom.messages import RangeScan, Sweep
from navloom.plugins import Discovery
from navloom.plugins.hooks import hookimpl
from navloom.plugins.one_file import available_points
from navloom.plugins.registry import Registry
from navloom.recording.imported import INSTANCE, RANGE_SCAN, SWEEP
from navloom.roles import InputError, Platform, PlatformInput, PlatformOutput

__all__ = ["RecordedPlatform", "discovery", "navloom_register"]


class RecordedPlatform(Platform):
    """What stands for the robot of a log."""

    name = INSTANCE
    sensor_kinds = {RANGE_SCAN: RangeScan, SWEEP: Sweep}

    def advance(self, given: PlatformInput) -> PlatformOutput:
        """A log cannot be driven. Raises InputError."""
        raise InputError("the platform of an imported log cannot drive: replay it instead")


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Register it."""
    registry.add(RecordedPlatform)


def discovery() -> Discovery:
    """The plugins installed, and this one: an installed one of its own would be offered for robots that drive."""
    own = EntryPoint(f"platform.{INSTANCE}", "navloom.recording.recorded_platform", GROUP)
    return Discovery((), [*available_points(), own])
