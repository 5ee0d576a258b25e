"""Parses `.msg`, `.srv` and `.action` texts, for `message_types`.

As in ROS, a service defines three types: request, response and event. An action defines a goal, a result, a feedback,
two services and a message that carries the feedback (design.ros2.org, on interfaces and actions).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import TypesysError, get_types_from_msg

from navloom_ros.errors import BadDefinition

__all__ = ["KINDS", "Definitions", "check_references", "definitions_in", "types_of"]

Definitions = dict[str, tuple[list[Any], list[tuple[str, Any]]]]
"""Constants and fields by type name, as in `rosbags`."""

KINDS = ("msg", "srv", "action")
LONGEST_TEXT = 1 << 20
"""Longest definition, characters."""
MOST_FILES = 10_000
"""Most definitions in a folder."""
DEEPEST = 64
"""Most levels of nested types."""
_TYPE_NAME = re.compile(r"[a-z][a-z0-9_]*/(msg|srv|action)/[A-Z][A-Za-z0-9]*")
_SEPARATOR = re.compile(r"^---[ \t]*$", re.MULTILINE)
_PARTS = {"msg": 1, "srv": 2, "action": 3}
_GOAL_ID = "unique_identifier_msgs/UUID goal_id\n"


def definitions_in(folder: Path) -> Iterator[tuple[str, str]]:
    """Name and text of every definition in a folder, at any depth, laid out as `package/msg/Name.msg`.

    Raises:
        BadDefinition: No such folder, too many or too large files, or a text that is not UTF-8.
    """
    if not folder.is_dir():
        raise BadDefinition(f"{folder}: no such folder; expected one that has package/msg/Name.msg in it")
    # Sorted: a file system lists in any order, and an error should name the same file each time.
    files = [path for kind in KINDS for path in sorted(folder.rglob(f"{kind}/*.{kind}"))]
    if len(files) > MOST_FILES:
        raise BadDefinition(f"{folder}: {len(files)} definitions; at most {MOST_FILES} are read: give a smaller folder")
    for path in files:
        name = f"{path.parent.parent.name}/{path.parent.name}/{path.stem}"
        try:
            # Before it is read: the folder may hold anything.
            if path.stat().st_size > LONGEST_TEXT:
                raise BadDefinition(f"{path}: longer than {LONGEST_TEXT} bytes")
            yield name, path.read_text("utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise BadDefinition(f"{path}: {error}") from None


def types_of(name: str, text: str) -> Definitions:
    """All types that a text defines.

    Args:
        name: `package/kind/Name`; the kind says how many parts the text has.
        text: Content of a file of that kind.

    Raises:
        BadDefinition: The name or the text breaks the rules.
    """
    if not _TYPE_NAME.fullmatch(name):
        raise BadDefinition(f"type {name!r}: expected package/msg/Name, package/srv/Name or package/action/Name")
    package, kind, _ = name.split("/")
    parts = _SEPARATOR.split(text.replace("\r\n", "\n"))
    if len(parts) != _PARTS[kind]:
        raise BadDefinition(f"{name}: {len(parts)} parts between lines of ---; a .{kind} text has {_PARTS[kind]}")
    if kind == "msg":
        return _parsed(name, parts[0], package)
    if kind == "srv":
        return _service(name, parts[0], parts[1], package)
    goal, result, feedback = (f"{name}_{part}" for part in ("Goal", "Result", "Feedback"))
    defined: Definitions = {}
    for part, body in zip((goal, result, feedback), parts, strict=True):
        defined |= _parsed(part, body, package)
    accepted = "bool accepted\nbuiltin_interfaces/Time stamp\n"
    defined |= _service(f"{name}_SendGoal", f"{_GOAL_ID}{goal} goal\n", accepted, package)
    defined |= _service(f"{name}_GetResult", _GOAL_ID, f"int8 status\n{result} result\n", package)
    defined |= _parsed(f"{name}_FeedbackMessage", f"{_GOAL_ID}{feedback} feedback\n", package)
    fields = {
        "goal": goal,
        "result": result,
        "feedback": feedback,
        "send_goal_service": f"{name}_SendGoal",
        "get_result_service": f"{name}_GetResult",
        "feedback_message": f"{name}_FeedbackMessage",
    }
    defined[name] = ([], [(field, (Nodetype.NAME, other)) for field, other in fields.items()])
    return defined


def check_references(defined: Definitions, known: Mapping[str, Any]) -> None:
    """Refuse types that refer to an undefined type, or to themselves.

    Raises:
        BadDefinition: Names the type, the field and the type that it refers to.
    """
    refers = {
        name: [(field, other) for field, descriptor in fields if (other := _referred(descriptor)) is not None]
        for name, (_, fields) in defined.items()
    }
    for name, references in refers.items():
        for field, other in references:
            if other not in defined and other not in known:
                raise BadDefinition(f"{name}: field {field!r} is of {other!r}, which is not known: give its text too")
    finished: set[str] = set()
    for name in refers:
        _refuse_circles([name], refers, finished)


def _refuse_circles(path: list[str], refers: Mapping[str, list[tuple[str, str]]], finished: set[str]) -> None:
    """Follow the references of the last type of a path, depth first; each type is visited once."""
    for field, other in refers[path[-1]]:
        if other in path:
            # Such a message would have no end.
            raise BadDefinition(f"{path[-1]}: field {field!r} is of {other!r}, which contains this type itself")
        if len(path) == DEEPEST:
            raise BadDefinition(f"{path[0]}: types nested more than {DEEPEST} levels deep")
        if other in refers and other not in finished:
            _refuse_circles([*path, other], refers, finished)
    finished.add(path[-1])


def _service(name: str, request: str, response: str, package: str) -> Definitions:
    defined = _parsed(f"{name}_Request", request, package) | _parsed(f"{name}_Response", response, package)
    event = [
        ("info", (Nodetype.NAME, "service_msgs/msg/ServiceEventInfo")),
        ("request", (Nodetype.SEQUENCE, ((Nodetype.NAME, f"{name}_Request"), 1))),
        ("response", (Nodetype.SEQUENCE, ((Nodetype.NAME, f"{name}_Response"), 1))),
    ]
    defined[f"{name}_Event"] = ([], event)
    messages = {part: f"{name}_{part.capitalize()}" for part in ("request", "response", "event")}
    defined[name] = ([], [(f"{part}_message", (Nodetype.NAME, other)) for part, other in messages.items()])
    return defined


def _parsed(name: str, text: str, package: str) -> Definitions:
    if len(text) > LONGEST_TEXT:
        raise BadDefinition(f"{name}: longer than {LONGEST_TEXT} characters")
    if re.search(r"^\s*wstring\b", text, re.MULTILINE):
        raise BadDefinition(f"{name}: `wstring` is not supported; use `string`")
    try:  # the parser resolves types without a package in the package of the name that it gets
        ((constants, fields),) = get_types_from_msg(text, f"{package}/msg/{name.rpartition('/')[2]}").values()
    except TypesysError as error:
        raise BadDefinition(f"{name}: not a definition: {str(error)[:200]}") from None
    if len({field for field, _ in fields}) != len(fields):
        raise BadDefinition(f"{name}: two fields have the same name")
    return {
        name: (
            list(constants),
            # IDL has no empty struct, so ROS adds this member, and it is on the wire.
            list(fields) or [("structure_needs_at_least_one_member", (Nodetype.BASE, ("uint8", 0)))],
        )
    }


def _referred(descriptor: Any) -> str | None:
    kind, rest = descriptor
    if kind not in (Nodetype.BASE, Nodetype.NAME):
        kind, rest = rest[0]
    return str(rest) if kind == Nodetype.NAME else None
