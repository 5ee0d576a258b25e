"""Liveliness tokens of rmw_zenoh, which announce nodes and endpoints, and attachments, the metadata of each message.

Sources: `liveliness_utils.cpp` and `attachment_helpers.cpp` of ros2/rmw_zenoh.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import xxhash

from navloom_ros.errors import BadToken
from navloom_ros.names import dds_type, ros_type
from navloom_ros.qos import Qos

__all__ = ["KINDS", "PREFIX", "Attachment", "Entity"]

PREFIX = "@ros2_lv"
"""First part of every token."""
KINDS = {"NN": "node", "MP": "publisher", "MS": "subscription", "SS": "service", "SC": "client"}
"""Kinds of entities, by the letters in a token."""
LONGEST = 4096
"""Longest token that is read, characters."""
_NODE_PARTS, _ENDPOINT_PARTS = 9, 13
_GID = 16
_ATTACHMENT = struct.Struct(f"<qqB{_GID}s")


@dataclass(frozen=True)
class Entity:
    """A node, or an endpoint of one: publisher, subscription, service or client.

    Attributes:
        kind: A key of KINDS.
        domain: ROS_DOMAIN_ID.
        session: Zenoh id of the process, hexadecimal.
        node_id, entity_id: Unique in the process; numbers in rmw_zenoh. Equal for a node.
        namespace, node: Namespace and name of the node.
        name: Full name of the topic or service; empty for a node.
        type_name: `package/kind/Name`; empty for a node.
        type_hash: Hash of the type; empty for a node.
        qos: Quality of service; None for a node.
        enclave: Security enclave; not used here.
    """

    kind: str
    domain: int
    session: str
    node_id: str
    entity_id: str
    namespace: str
    node: str
    name: str = ""
    type_name: str = ""
    type_hash: str = ""
    qos: Qos | None = None
    enclave: str = "/"

    @property
    def full_node_name(self) -> str:
        """The node with its namespace."""
        return f"{self.namespace.rstrip('/')}/{self.node}"

    @property
    def token(self) -> str:
        """The key of its liveliness token."""
        parts = [PREFIX, str(self.domain), self.session, self.node_id, self.entity_id, self.kind]
        parts += [_mangled(part) for part in (self.enclave, self.namespace, self.node)]
        if self.qos is not None:
            parts += [_mangled(self.name), dds_type(self.type_name), self.type_hash, self.qos.text]
        return "/".join(parts)

    @property
    def gid(self) -> bytes:
        """Its ROS identifier, 16 bytes: XXH3-128 of its token, lower half first."""
        return xxhash.xxh3_128_intdigest(self.token.encode()).to_bytes(_GID, "little")

    @classmethod
    def parsed(cls, token: str) -> Entity:
        """Parse a token; parts that newer versions append are ignored.

        Raises:
            BadToken: Not of this form.
        """
        parts = token.split("/") if len(token) <= LONGEST else []
        least = _NODE_PARTS if parts[5:6] == ["NN"] else _ENDPOINT_PARTS
        if len(parts) < least or parts[0] != PREFIX or parts[5] not in KINDS:
            raise BadToken(
                f"token {token[:200]!r}: expected {PREFIX}/domain/session/node/entity/kind/enclave/namespace/…"
            )
        # int() would also take signs, underscores and the digits of other scripts.
        if not (parts[1].isascii() and parts[1].isdecimal()):
            raise BadToken(f"token {token[:200]!r}: domain {parts[1]!r} is not a number")
        enclave, namespace, node = (_unmangled(part) for part in parts[6:9])
        head = (parts[5], int(parts[1]), parts[2], parts[3], parts[4], namespace, node)
        if parts[5] == "NN":
            return cls(*head, enclave=enclave)
        name, type_name, type_hash = _unmangled(parts[9]), ros_type(parts[10]), parts[11]
        return cls(*head, name, type_name, type_hash, Qos.parsed(parts[12]), enclave)


@dataclass(frozen=True)
class Attachment:
    """Metadata that is sent with a message.

    Attributes:
        sequence: Number of the message or request, from 1.
        source_ns: When it was sent, ns since the epoch on the sender's clock.
        gid: Gid of the publisher; for a request and its response, of the client.
    """

    sequence: int
    source_ns: int
    gid: bytes

    @property
    def data(self) -> bytes:
        """The 33 bytes on the wire: sequence, time, length of the gid, gid."""
        return _ATTACHMENT.pack(self.sequence, self.source_ns, _GID, self.gid)

    @classmethod
    def parsed(cls, data: bytes) -> Attachment:
        """Parse an attachment; bytes that newer versions append are ignored.

        Raises:
            BadToken: Too short, or another length of the gid.
        """
        if len(data) < _ATTACHMENT.size:
            raise BadToken(f"attachment of {len(data)} bytes; expected {_ATTACHMENT.size}")
        sequence, source_ns, length, gid = _ATTACHMENT.unpack_from(data)
        if length != _GID:
            raise BadToken(f"attachment with a gid of {length} bytes; expected {_GID}")
        return cls(sequence, source_ns, gid)


def _mangled(part: str) -> str:
    # A slash separates the parts of a Zenoh key, and none of them may be empty.
    return part.replace("/", "%") or "%"


def _unmangled(part: str) -> str:
    return part.replace("%", "/")
