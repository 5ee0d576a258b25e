"""The generated parts of messages.md: every message with its fields, and the bounds of their size."""

from __future__ import annotations

import dataclasses
import inspect
import re
from typing import Any, get_args

import navloom.messages
from navloom.cli.describing.docstrings import meanings
from navloom.messages import SCHEMAS, Envelope, Message, ReasonCode
from navloom.messages.bounds import header_limit, size_limit
from navloom.messages.kinds import MAX_ITEMS, MAX_TEXT, Kind
from navloom.messages.stop_reasons import StopKind
from tables import code, table

__all__ = ["PARTS", "with_parts"]

GROUPS = {
    "Poses and velocities": ("Point2D", "Pose2D", "Twist2D"),
    "From the platform": ("Odometry", "RangeScan", "Sweep", "Contact", "Truth"),
    "From trackers": ("Tracks",),
    "Of the simulated world": ("Bodies",),
    "Pose and map": ("PoseEstimate", "Hypotheses", "PoseTrack", "OccupancyGrid", "Count", "MapUpdate", "ClearRequest",
                     "SweepRequest"),
    "Plans": ("PlanRequest", "Path", "PlanFailure", "Drive", "Trajectory", "Reference"),
    "Commands": ("Command", "TrackingCommand", "Avoidance", "AvoiderStatus", "AvoiderDiagnostics", "HandOver",
                 "RecoveryRequest", "RecoveryStep", "GateStatus", "StopReason", "Selection"),
    "Goals and operators": ("Goal", "OperatorRequest", "Feedback", "GoalResult"),
    "Steps": ("StepReport", "InputRead", "PortMark", "Parameters"),
}  # fmt: skip
"""Sections of the page -> their messages, in the order in which a reader meets them."""
RULES = {"": "", "heading": ", in [-π, π]", "positive": ", > 0", "not_negative": ", >= 0", "stamp": ", >= 0"}
"""Rule of a number -> how the page writes it."""
NAMED = {get_args(StopKind): "kind of stop", get_args(ReasonCode): "reason code"}
"""Enumerations that grow, and that `navloom messages` lists -> how the page calls them."""
BOUNDED = {MAX_TEXT: "str", 255: "name"}
"""Bound of a text, bytes -> its type as the page writes it."""


def classes() -> dict[str, type[Message]]:
    """The framework's messages by name.

    Raises:
        ValueError: One is in no group, or in several.
    """
    ours = [cls for cls in SCHEMAS.values() if cls.__module__.startswith(navloom.messages.__name__)]
    grouped = [name for names in GROUPS.values() for name in names]
    if sorted(grouped) != sorted(cls.__name__ for cls in ours):
        differing = set(grouped) ^ {cls.__name__ for cls in ours}
        raise ValueError(f"GROUPS must list each message once; it differs by {differing or 'one that is there twice'}")
    return {cls.__name__: cls for cls in ours}


def written(kind: Kind) -> str:
    """A kind of field, in the words of the page's table of types."""
    if kind.array is not None:
        text = f"{kind.array.dtype} ({', '.join(map(str, kind.array.shape))})"
        text += ", +inf allowed" if kind.array.infinite else ""
        text += "" if kind.array.at_least is None else f", >= {kind.array.at_least:g}"
        text += "" if kind.array.at_most is None else f", <= {kind.array.at_most:g}"
        text += "" if kind.array.may_be_empty else ", not empty"
    elif kind.message is not None:
        text = f"[{kind.message.__name__}](#{kind.message.__name__.lower()})"
    elif kind.item is not None:
        text = f"tuple of {written(kind.item)}" + (f", at most {kind.most}" if kind.most != MAX_ITEMS else "")
    elif kind.choices:
        text = NAMED.get(kind.choices) or " / ".join(choice or "empty" for choice in kind.choices)
    elif kind.form == "str":
        text = "words" if kind.is_cut else BOUNDED.get(kind.most) or f"str, at most {kind.most} bytes"
    else:
        text = kind.form + (", +inf allowed" if kind.infinite else "") + RULES[kind.rule]
    return f"{text} or None" if kind.optional else text


def prose_of(cls: type[Any]) -> str:
    """The docstring of a class above its list of fields."""
    return (inspect.getdoc(cls) or "").partition("Attributes:\n")[0].strip()


def field_table(cls: type[Message]) -> str:
    """The fields of a message."""
    told = meanings(inspect.getdoc(cls) or "")
    return table(("field", "type", "meaning"), [(code(n), written(kind), told[n]) for n, kind in cls.kinds.items()])


def constructor(cls: Any) -> str:
    """How it is made: its fields with their defaults."""
    made = ", ".join(
        field.name if field.default is dataclasses.MISSING else f"{field.name}={field.default!r}"
        for field in dataclasses.fields(cls)
    )
    return code(f"{cls.__name__}({made})")


def message_sections() -> str:
    """Every message, below the anchor by which the types of the reference link to it."""
    known, parts = classes(), []
    for title, names in GROUPS.items():
        parts.append(f"## {title}")
        for cls in (known[name] for name in names):
            head = f"[](){{#navloom.messages.{cls.__name__}}}\n### {cls.__name__}"
            parts += [head, constructor(cls), prose_of(cls), field_table(cls)]
    return "\n\n".join(parts)


def envelope_table() -> str:
    """The fields of the envelope."""
    told = meanings(inspect.getdoc(Envelope) or "")
    return table(("field", "meaning"), [(code(name), told[name]) for name in Envelope._fields])


def size_table() -> str:
    """The bounds of every message."""
    rows = [(name, header_limit(cls), size_limit(cls) or "arrays") for name, cls in sorted(classes().items())]
    return table(("message", "header, bytes at most", "whole message, bytes at most"), rows)


PARTS = {"messages": message_sections, "envelope": envelope_table, "sizes": size_table}
"""What stands for `<!-- generated: NAME -->` on the page."""


def with_parts(markdown: str) -> str:
    """The page with its generated parts."""
    return re.sub(r"^<!-- generated: (\w+) -->$", lambda found: PARTS[found[1]](), markdown, flags=re.MULTILINE)
