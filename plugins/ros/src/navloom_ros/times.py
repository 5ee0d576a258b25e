"""ROS times, `sec` and `nanosec`, and ns."""

from __future__ import annotations

from typing import Any

__all__ = ["ns_of", "time_of"]

SECOND = 1_000_000_000


def ns_of(time: Any) -> int:
    """A ROS time or duration as ns."""
    return int(time.sec) * SECOND + int(time.nanosec)


def time_of(nanoseconds: int) -> dict[str, int]:
    """Values of the ROS time or duration of so many ns."""
    # Rounded down, also before 0: nanosec is unsigned.
    seconds, rest = divmod(nanoseconds, SECOND)
    return {"sec": seconds, "nanosec": rest}
