"""Endpoints: addresses of the network, as written in a config or on the command line."""

from __future__ import annotations

import ipaddress
import re
import socket
from dataclasses import dataclass

from navloom.errors import NavloomError

__all__ = ["Endpoint", "LinkError"]

_LOCAL, _PLAIN, _SECURE = ("unixsock-stream",), ("tcp", "udp"), ("tls",)


class LinkError(NavloomError, ValueError):
    """A link is refused. The text says why and what to do."""


@dataclass(frozen=True)
class Endpoint:
    """One end of a connection.

    Attributes:
        text: The endpoint as given.
        protocol: unixsock-stream, tcp, udp or tls.
        host: Name or address without brackets, or the path of a socket.
        port: 0 for a socket.
        priorities: "prio=1-3", or empty for all.
    """

    text: str
    protocol: str
    host: str
    port: int = 0
    priorities: str = ""

    @staticmethod
    def parse(text: str) -> Endpoint:
        """Parse an endpoint. Raises LinkError if it is malformed."""
        protocol, slash, address = text.partition("/")
        if not slash or protocol not in (*_LOCAL, *_PLAIN, *_SECURE):
            raise LinkError(
                f"endpoint {text!r}: unknown protocol {protocol!r}, expected tls/HOST:PORT, tcp/HOST:PORT, "
                "udp/HOST:PORT or unixsock-stream/PATH"
            )
        # Zenoh would take them, and with them any certificate.
        if "#" in text:
            raise LinkError(f"endpoint {text!r}: settings after # are not taken; certificates come from --keys")
        address, _, priorities = address.partition("?")
        if priorities and not re.fullmatch(r"prio=[0-7]-[0-7]", priorities):
            raise LinkError(f"endpoint {text!r}: {priorities!r} after ?, expected prio=1-3")
        if protocol in _LOCAL:
            if not address.startswith("/"):
                raise LinkError(f"endpoint {text!r}: expected an absolute path, as unixsock-stream//run/robot/x.sock")
            return Endpoint(text, protocol, address, 0, priorities)
        found = re.fullmatch(r"(?:\[([^\]]+)\]|([^\[\]:]+)):([0-9]{1,5})", address)
        if found is None or not 0 < int(found[3]) < 65536:
            raise LinkError(
                f"endpoint {text!r}: expected {protocol}/HOST:PORT with a port of 1 to 65535, "
                f"as {protocol}/127.0.0.1:7447 or {protocol}/[::1]:7447"
            )
        return Endpoint(text, protocol, found[1] or found[2], int(found[3]), priorities)

    @property
    def is_socket(self) -> bool:
        """Whether it is a socket file of this host."""
        return self.protocol in _LOCAL

    @property
    def is_secure(self) -> bool:
        """Whether it is encrypted, with certificates on both sides."""
        return self.protocol in _SECURE

    @property
    def is_wildcard(self) -> bool:
        """Whether it means every interface of the host."""
        return self.host == "*" or (self._address is not None and self._address.is_unspecified)

    @property
    def is_local(self) -> bool:
        """Whether it cannot be reached from another host. A name other than localhost may be anywhere."""
        if self.protocol in _LOCAL or self.host == "localhost":
            return True
        return self._address is not None and self._address.is_loopback

    @property
    def _address(self) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
        if self.protocol in _LOCAL:
            return None
        try:
            address = ipaddress.ip_address(self.host)
        except ValueError:
            try:  # "0" and "0x7f.1" are addresses for the system's resolver
                return ipaddress.IPv4Address(socket.inet_aton(self.host))
            except OSError:
                return None
        # ::ffff:127.0.0.1 is this host, too.
        mapped = address.ipv4_mapped if isinstance(address, ipaddress.IPv6Address) else None
        return mapped or address
