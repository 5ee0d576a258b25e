"""Serves a web page or metrics to browsers and scrapers that may be slow, hostile, or many.

A page of another site must not reach a server on loopback: `guarded` checks Host and Origin. A client that sends half a
request, or thousands of connections, must not keep others waiting: `WebServer` limits both.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import ipaddress
import logging
import socket
import ssl
import threading
from collections.abc import Awaitable, Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import uvicorn
from navloom.cli.interrupts import ending
from navloom.errors import NavloomError
from uvicorn.protocols.http.h11_impl import H11Protocol

__all__ = ["BindError", "Receive", "Scope", "Send", "WebServer", "guarded", "is_loopback"]

HEAD_WAIT = 5.0
"""Longest time from a connection to a whole request head, s, between two requests, and of a TLS handshake."""
CONNECTIONS = 256
"""Most connections at once. One more ends the connection that has waited longest without a whole request head."""
BACKLOG = 512
"""Most connections that are accepted at once: with CONNECTIONS, below the usual limit of 1024 open files."""
HEAD_SIZE = 16_384
"""Largest request head, bytes."""
WS_MESSAGE = 65_536
"""Largest websocket message of a client, bytes."""
PING_INTERVAL, PING_WAIT = 5.0, 20.0
"""Interval of pings to websocket clients, and longest wait for an answer, s: longer than a bad link takes."""
WAITING = 32_768
"""Most bytes that wait for a slow client before its sender has to wait, in this process and in the kernel each."""
END_WAIT = 2.0
"""Longest orderly end of connections, s."""
OWNER = "navloom.certificate"
"""Key of a request's scope with the common name of its browser's certificate."""
HEADERS = [
    (b"content-security-policy", b"default-src 'self'; object-src 'none'; base-uri 'none'; form-action 'self'; "
                                 b"frame-ancestors 'none'"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
]  # fmt: skip
"""Headers of every answer. The policy has no inline script and nothing from other hosts."""

Scope = dict[str, Any]
Receive = Callable[[], Awaitable[Any]]
Send = Callable[[Any], Awaitable[None]]
Application = Callable[[Scope, Receive, Send], Awaitable[None]]


class BindError(NavloomError, OSError):
    """The server cannot listen at the address."""


def guarded(app: Application, names: Iterable[str]) -> Application:
    """Refuse requests for another host, and those that a page of another site sends; add HEADERS to every answer.

    A page of an attacker whose name is made to point to this host (DNS rebinding) sends that name as Host.

    Args:
        app: What answers the other requests.
        names: Names of this host by which it may be reached; addresses and localhost are always good, because no
            attacker can make one point elsewhere.
    """
    known = {"localhost", *(name.lower() for name in names)}

    async def checked(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await app(scope, receive, send)
            return
        given = [(name, value.decode("latin-1")) for name, value in scope["headers"]]
        hosts = [value for name, value in given if name == b"host"]
        origins = [value for name, value in given if name == b"origin"]
        why = _why_refused(scope, hosts, origins, known)
        if why:
            await _refuse(scope, receive, send, why)
        else:
            await app(scope, receive, _with_headers(send))

    return checked


def _why_refused(scope: Scope, hosts: list[str], origins: list[str], known: set[str]) -> str:
    if len(hosts) != 1 or not (is_address(name := host_name(hosts[0])) or name in known):
        known_names = " or ".join(sorted(known))
        return f"this server is not {', '.join(hosts) or 'nameless'}: reach it as {known_names}, or by its address"
    secure = scope["scheme"] in ("https", "wss")
    own = f"{'https' if secure else 'http'}://{hosts[0].lower()}"
    # Browsers always send the origin with websockets, and with requests of other methods than GET and HEAD.
    if any(origin.lower() != own for origin in origins) or len(origins) > 1:
        return "pages of other sites may not use this server"
    if not origins and scope["type"] == "websocket":
        return "a websocket needs the header Origin"
    return ""


def host_name(host: str) -> str:
    """The name in a Host header, without its port; empty if it is none."""
    name, colon, port = host.lower().rpartition(":")
    if not colon or name.endswith(":") or (host.startswith("[") and "]" not in name):
        name, port = host.lower(), "0"
    return name if port.isdecimal() and port.isascii() else ""


def is_address(name: str) -> bool:
    """Whether the name in a Host header is an IP address; one of version 6 is in brackets."""
    is_sixth = name.startswith("[") and name.endswith("]")
    with contextlib.suppress(ValueError):
        return (ipaddress.ip_address(name[1:-1] if is_sixth else name).version == 6) == is_sixth
    return False


async def _refuse(scope: Scope, receive: Receive, send: Send, why: str) -> None:
    kind = "websocket.http.response" if scope["type"] == "websocket" else "http.response"
    if scope["type"] == "websocket":
        await receive()
    body = why.encode()
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"content-length", str(len(body)).encode()), *HEADERS]
    await send({"type": f"{kind}.start", "status": 403, "headers": headers})
    await send({"type": f"{kind}.body", "body": body})


def _with_headers(send: Send) -> Send:
    async def sending(message: Any) -> None:
        if message["type"] in ("http.response.start", "websocket.http.response.start"):
            message = {**message, "headers": [*message.get("headers", ()), *HEADERS]}
        await send(message)

    return sending


NO_FAULTS = ("without completing handshake", "running task(s)")
"""What uvicorn logs as an error and is none: a websocket that is refused with a reason, a page open at the end."""
logging.getLogger("uvicorn.error").addFilter(lambda record: not any(text in str(record.msg) for text in NO_FAULTS))


class _Connection(H11Protocol):
    """A connection that is closed if its request head does not come, or if it is one too many."""

    waiting: dict[_Connection, asyncio.TimerHandle]

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        if certificate := transport.get_extra_info("peercert"):
            self.app = _named(self.app, dict(part[0] for part in certificate["subject"])["commonName"])
        transport.set_write_buffer_limits(high=WAITING)
        with contextlib.suppress(OSError, AttributeError):
            # Old frames must not wait in the kernel for a slow client: what is not sent yet can still be replaced.
            transport.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, WAITING)
        self._wait_for_head()
        if len(self.connections) > CONNECTIONS:
            oldest = next(iter(self.waiting))
            oldest.transport.abort()
            oldest._stop_waiting()
            self.connections.discard(oldest)

    def connection_lost(self, exc: Exception | None) -> None:
        self._stop_waiting()
        super().connection_lost(exc)

    def handle_events(self) -> None:
        before = self.cycle
        super().handle_events()
        if self.cycle is not before or self.transport.get_protocol() is not self:
            self._stop_waiting()

    def on_response_complete(self) -> None:
        super().on_response_complete()
        if not self.transport.is_closing():
            self._wait_for_head()

    def _wait_for_head(self) -> None:
        self._stop_waiting()
        self.waiting[self] = self.loop.call_later(HEAD_WAIT, self._give_up)

    def _stop_waiting(self) -> None:
        timer = self.waiting.pop(self, None)
        if timer is not None:
            timer.cancel()

    def _give_up(self) -> None:
        self.waiting.pop(self, None)
        self.transport.abort()


def _named(app: Any, name: str) -> Application:
    """The application, with the common name of the browser's certificate in its scope."""

    async def named(scope: Scope, receive: Receive, send: Send) -> None:
        await app({**scope, OWNER: name}, receive, send)

    return named


def _abrupt_websockets() -> type[asyncio.Protocol]:
    """uvicorn's websockets, but one that does not answer pings is cut off: an orderly end would wait until it reads."""
    from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

    class AbruptWebsocket(WebSocketsSansIOProtocol):
        def keepalive_timeout(self) -> None:
            super().keepalive_timeout()
            self.transport.abort()

    return AbruptWebsocket


class WebServer:
    """Listens at an address, and serves an ASGI application there; `guarded` makes one safe for browsers.

    Args:
        address: Host and port to listen at; port 0 takes a free one.
        tls: Certificate file NAME.pem of a kind that accepts connections; NAME-key.pem is beside it. None for HTTP.
        websockets: The application takes websockets; the package `websockets` is needed then.
        certificates: Ask browsers for a certificate of the same authority, `ca.pem` beside `tls`; they need not have
            one. `kind_of` tells whose it is.

    Raises:
        BindError: The address is taken, does not belong to this host, or the certificate cannot be used.
    """

    def __init__(
        self, address: tuple[str, int], tls: Path | None = None, websockets: bool = False, certificates: bool = False
    ) -> None:
        self._tls = tls
        protocol = type("Connection", (_Connection,), {"waiting": {}})
        self._settings: dict[str, Any] = {
            "http": protocol,
            "ws": _abrupt_websockets() if websockets else "none",
            "lifespan": "auto",
            "log_config": None,
            "log_level": logging.ERROR,
            "access_log": False,
            "proxy_headers": False,
            "server_header": False,
            "backlog": BACKLOG,
            "ws_max_size": WS_MESSAGE,
            "ws_ping_interval": PING_INTERVAL,
            "ws_ping_timeout": PING_WAIT,
            "ws_per_message_deflate": False,
            "h11_max_incomplete_event_size": HEAD_SIZE,
            "timeout_keep_alive": round(HEAD_WAIT),
            "timeout_graceful_shutdown": round(END_WAIT),
            "ssl_context_factory": None if tls is None else lambda *_: _context(tls, certificates),
        }
        try:
            if tls is not None:
                _context(tls, certificates)
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", "") or error
            raise BindError(f"certificate {tls}: {why}; expected NAME.pem with NAME-key.pem beside it") from None
        try:
            self._socket = _listening(address)
        except OSError as error:
            raise BindError(f"{address[0]}:{address[1]}: cannot be listened at: {error.strerror}") from None
        self._server: uvicorn.Server | None = None
        self._thread: threading.Thread | None = None

    @property
    def url(self) -> str:
        """URL of the server, without a path."""
        host, port = self._socket.getsockname()[:2]
        shown = f"[{host}]" if ":" in host else host
        return f"{'http' if self._tls is None else 'https'}://{shown}:{port}"

    @property
    def port(self) -> int:
        """Its port."""
        return int(self._socket.getsockname()[1])

    @property
    def names(self) -> tuple[str, ...]:
        """Host names and addresses of its certificate."""
        if self._tls is None:
            return ()
        from navloom_live.transport.certificates import hosts_of

        return tuple(f"[{name}]" if ":" in name else name for name in hosts_of(self._tls))

    def kind_of(self, scope: Mapping[str, Any]) -> str:
        """Kind of the identity whose certificate a request came with; empty without one that is admitted now."""
        from navloom_live.transport.access import kind_of

        name = scope.get(OWNER)
        return "" if name is None or self._tls is None else kind_of(self._tls.parent, name)

    @property
    def connections(self) -> int:
        """Number of connections that it has."""
        return 0 if self._server is None else len(self._server.server_state.connections)

    def run(self, app: Application) -> None:
        """Serve until Ctrl-C or SIGTERM."""
        with ending() as event:
            self.start(app)
            while not event.wait(0.2) and self._thread is not None and self._thread.is_alive():
                pass
            self.close()

    def start(self, app: Application) -> None:
        """Serve on a thread of its own until `close`."""
        server = self._server = uvicorn.Server(uvicorn.Config(app, **self._settings))

        async def serve() -> None:
            if self._tls is not None:
                loop = asyncio.get_running_loop()
                # uvicorn has no setting for it; asyncio's own limit is 60 s.
                loop.create_server = functools.partial(loop.create_server, ssl_handshake_timeout=HEAD_WAIT)  # type: ignore[method-assign]
            await server._serve([self._socket])  # `serve` would take over the signals of this process

        self._thread = threading.Thread(target=lambda: asyncio.run(serve()), name="web server", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop serving."""
        if self._server is not None:
            self._server.should_exit = True
        if self._thread is not None:
            self._thread.join(END_WAIT + 1.0)
        with contextlib.suppress(OSError):
            self._socket.close()


def _listening(address: tuple[str, int]) -> socket.socket:
    family, _, _, _, where = socket.getaddrinfo(*address, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0]
    return socket.create_server(where[:2], family=family, backlog=BACKLOG)


def _context(certificate: Path, asks: bool) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.load_cert_chain(certificate, certificate.with_name(f"{certificate.stem}-key.pem"))
    if asks:
        context.load_verify_locations(certificate.with_name("ca.pem"))
        context.verify_mode = ssl.CERT_OPTIONAL
    return context


def is_loopback(host: str) -> bool:
    """Whether an address is reached from this host only."""
    with contextlib.suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return host == "localhost"
