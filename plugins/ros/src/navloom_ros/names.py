"""ROS 2 names, and the Zenoh keys that rmw_zenoh derives from them.

Source: design.ros2.org, "Topic and Service name mapping".
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from navloom_ros.errors import BadName

__all__ = [
    "NAMESPACES",
    "check_namespace",
    "check_node_name",
    "dds_type",
    "full_name",
    "key_of",
    "plain_buffer_key",
    "remapping",
    "ros_type",
]

NAMESPACES = "::"
"""Separator between the parts of a type's name on the wire."""
_TOKEN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_NODE = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,254}")
_LONGEST = 248
"""Longest full name that ROS allows, characters."""


def full_name(name: str, namespace: str = "/", node: str = "", remap: Mapping[str, str] | None = None) -> str:
    """Expand a name: `scan` in the namespace `/r1` becomes `/r1/scan`, `~/scan` becomes `/r1/node/scan`.

    Args:
        name: Of a topic, service or action; relative, private (`~`) or absolute.
        namespace: Of the node, with its leading slash.
        node: Name of the node.
        remap: New names by old name; both are expanded like the name.

    Raises:
        BadName: ROS does not allow it.
    """
    expanded = _expanded(name, namespace, node)
    # ROS compares the expanded names: `scan` and `/r1/scan` are the same in /r1.
    rules = {_expanded(old, namespace, node): new for old, new in (remap or {}).items()}
    return _expanded(rules[expanded], namespace, node) if expanded in rules else expanded


def remapping(rules: list[str]) -> dict[str, str]:
    """Parse remapping rules `old:=new`, the syntax of ROS programs, to new names by old name.

    Raises:
        BadName: A rule without `:=`, or with an invalid name.
    """
    parsed: dict[str, str] = {}
    for rule in rules:
        old, separator, new = rule.partition(":=")
        if not separator:
            raise BadName(f"remapping {rule!r}: expected OLD:=NEW, as scan:=/front/scan")
        _expanded(old, "/", "node")
        _expanded(new, "/", "node")
        parsed[old] = new
    return parsed


def check_namespace(namespace: str) -> str:
    """The namespace with its leading slash. Raises BadName if ROS does not allow it."""
    return "/" if namespace in ("", "/") else _expanded(namespace if namespace[0] == "/" else f"/{namespace}", "/", "")


def check_node_name(name: str) -> str:
    """Return the name. Raises BadName if ROS does not allow it."""
    if not _NODE.fullmatch(name):
        raise BadName(f"node name {name!r}: expected letters, digits and _, with no digit first")
    return name


def dds_type(name: str) -> str:
    """Type name on the wire: `sensor_msgs/msg/LaserScan` becomes `sensor_msgs::msg::dds_::LaserScan_`.

    A name of another form is returned unchanged.
    """
    parts = name.split("/")
    return NAMESPACES.join((*parts[:2], "dds_", f"{parts[2]}_")) if len(parts) == 3 else name


def ros_type(name: str) -> str:
    """Inverse of `dds_type`; a name of another form is returned unchanged."""
    parts = name.split(NAMESPACES)
    if len(parts) != 4 or parts[2] != "dds_" or not parts[3].endswith("_"):
        return name
    return f"{parts[0]}/{parts[1]}/{parts[3][:-1]}"


def key_of(domain: int, name: str, type_name: str, type_hash: str) -> str:
    """Zenoh key of a topic or service: `0/scan/sensor_msgs::msg::dds_::LaserScan_/RIHS01_…`.

    Args:
        domain: ROS_DOMAIN_ID.
        name: Full name, with its leading slash.
        type_name: `package/kind/Name`.
        type_hash: RIHS01, or `hashing.NOT_HASHED` for Humble.
    """
    return f"{domain}/{name.strip('/')}/{dds_type(type_name)}/{type_hash}"


def plain_buffer_key(key: str) -> str:
    """Second key on which publishers of Lyrical and later may send types with `uint8[]`, as plain CDR.

    They use it while all subscribers they know of accept buffers; such messages are not sent on the topic's own key.
    Source: rmw_zenoh `buffer_endpoint_helpers.hpp`.
    """
    return f"{key}/_buf_cpu"


def _expanded(name: str, namespace: str, node: str) -> str:
    if name == "~" or name.startswith("~/"):
        path = f"{namespace.rstrip('/')}/{node}{name[1:]}"
    elif name.startswith("/"):
        path = name
    else:
        path = f"{namespace.rstrip('/')}/{name}"
    if not path[1:] or not all(_TOKEN.fullmatch(part) for part in path[1:].split("/")) or len(path) > _LONGEST:
        raise BadName(f"name {name!r}: expected parts of letters, digits and _, with / between, as front/scan or /scan")
    return path
