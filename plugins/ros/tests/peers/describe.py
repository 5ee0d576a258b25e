"""Writes definitions and type descriptions that ROS 2's wheels lack, for the peers, in the layout of an installed ROS.

Their hashes are computed by navloom_ros; test_ros_types.py compares those with ROS's own.
"""

from __future__ import annotations

import json
from pathlib import Path

from navloom_ros.hashing import field_description
from navloom_ros.message_types import Types
from navloom_ros.texts import definitions_in

TF = {"tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n"}
NEEDED = (
    "action_msgs",
    "builtin_interfaces",
    "geometry_msgs",
    "nav_msgs",
    "service_msgs",
    "std_msgs",
    "unique_identifier_msgs",
)
"""Packages on which the written packages depend."""


def describe(types: Types, folders: list[Path], prefix: Path) -> None:
    """Write every definition of these folders, and tf2's, into `prefix/share/package/kind`."""
    texts = dict(TF)
    for folder in folders:
        texts |= dict(definitions_in(folder))
    for name, text in texts.items():
        package, kind, short = name.split("/")
        target = prefix / "share" / package / kind
        target.mkdir(parents=True, exist_ok=True)
        (target / f"{short}.{kind}").write_text(text, "utf-8")
        (target / f"{short}.json").write_text(json.dumps(_description(types, name)), "utf-8")
        (target.parent / "package.xml").write_text(_package(package), "utf-8")


def _package(name: str) -> str:
    needed = "".join(f"<depend>{other}</depend>" for other in NEEDED)
    return f"<package format='3'><name>{name}</name>{needed}</package>"


def _description(types: Types, name: str) -> dict[str, object]:
    seen: dict[str, list[dict[str, object]]] = {}
    waiting = [name]
    while waiting:
        current = waiting.pop()
        if current not in seen:
            seen[current] = [field_description(*field) for field in types.fields(current)]
            waiting += [
                field["type"]["nested_type_name"] for field in seen[current] if field["type"]["nested_type_name"]
            ]  # type: ignore[index]
    described = [{"type_name": one, "fields": fields} for one, fields in seen.items()]
    return {
        "type_description_msg": {"type_description": described[0], "referenced_type_descriptions": described[1:]},
        "type_hashes": [{"type_name": one, "hash_string": types.hash_of(one)} for one in seen],
    }
