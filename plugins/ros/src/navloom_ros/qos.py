"""Quality of service, and its text in the liveliness tokens of rmw_zenoh (`liveliness_utils.cpp`, `qos.cpp`).

`reliability:durability:history,depth:deadline s,ns:lifespan s,ns:liveliness,lease s,ns`; a default value is left empty.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from navloom_ros.errors import BadToken

__all__ = ["DEFAULT", "LATCHED", "SENSOR", "SERVICES", "Qos"]

DEFAULT_DEPTH = 42
"""Depth that the text leaves empty."""
MOST_KEPT = 1000
"""Most messages that a queue holds, also with keep all."""
_RELIABLE, _BEST_EFFORT = "1", "2"
_TRANSIENT_LOCAL, _VOLATILE = "1", "2"
_KEEP_LAST, _KEEP_ALL = "1", "2"
_REST = ":,:,:,,"
"""Default deadline, lifespan and liveliness; rmw_zenoh ignores them."""


@dataclass(frozen=True)
class Qos:
    """What a publisher offers or a subscription asks for.

    Attributes:
        reliable: Lost messages are sent again; otherwise best effort.
        transient_local: Late joiners get the last messages ("latched").
        depth: Length of the queue, messages; None to keep all.
    """

    reliable: bool = True
    transient_local: bool = False
    depth: int | None = 10

    @property
    def kept(self) -> int:
        """Length of a queue with this depth, messages."""
        return MOST_KEPT if self.depth is None else max(1, min(self.depth, MOST_KEPT))

    @property
    def text(self) -> str:
        """The text for a token."""
        reliability = "" if self.reliable else _BEST_EFFORT
        durability = _TRANSIENT_LOCAL if self.transient_local else ""
        history = f"{_KEEP_ALL}," if self.depth is None else f",{'' if self.depth == DEFAULT_DEPTH else self.depth}"
        return f"{reliability}:{durability}:{history}{_REST}"

    @classmethod
    def parsed(cls, text: str) -> Qos:
        """Parse the text of a token; unknown values of newer versions count as the default.

        Raises:
            BadToken: Not of this form.
        """
        parts = text.split(":")
        if len(parts) < 3 or parts[2].count(",") < 1:
            raise BadToken(f"QoS {text!r}: expected reliability:durability:history,depth:…")
        history, depth = parts[2].split(",")[:2]
        if depth and not re.fullmatch(r"[0-9]{1,20}", depth):
            raise BadToken(f"QoS {text!r}: depth {depth!r} is not a number")
        return cls(
            reliable=parts[0] != _BEST_EFFORT,
            transient_local=parts[1] == _TRANSIENT_LOCAL,
            depth=None if history == _KEEP_ALL else int(depth) if depth else DEFAULT_DEPTH,
        )

    def __str__(self) -> str:
        words = ["reliable" if self.reliable else "best effort"]
        if self.transient_local:
            words.append("transient local")
        words.append("keep all" if self.depth is None else f"depth {self.depth}")
        return ", ".join(words)


DEFAULT = Qos()
"""Default of topics, as in rclcpp and rclpy."""
SENSOR = Qos(reliable=False, depth=5)
"""For sensor data."""
LATCHED = Qos(transient_local=True, depth=1)
"""For maps, robot descriptions and the status of actions."""
SERVICES = Qos()
"""For services."""
