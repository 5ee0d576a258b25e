"""Finds out why a link does not come up: Zenoh says only that it could not connect."""

from __future__ import annotations

import contextlib
import socket
import ssl

from navloom_live.transport.links import Endpoint, Link

__all__ = ["why_not"]

_WORDS = {
    "CERTIFICATE_EXPIRED": "our certificate {own} has expired: `navloom keys renew` makes a new one",
    "UNKNOWN_CA": "our certificate {own} is of another authority: both sides need certificates of one "
    "`navloom keys new`",
    "DECRYPT_ERROR": "our certificate {own} is of another authority: both sides need certificates of one "
    "`navloom keys new`",
    "BAD_CERTIFICATE": "it refuses our certificate {own}: both sides need certificates of one `navloom keys new`",
    "WRONG_VERSION_NUMBER": "what listens there does not speak TLS: use tcp/…, or give the listener certificates",
    "UNEXPECTED_EOF": "what listens there does not speak TLS, or is not a navloom router",
}


def why_not(link: Link, patience: float = 2.0) -> str:
    """Try the first endpoint of a link once more, step by step.

    Args:
        link: A link that `settings` accepts.
        patience: Timeout of each step, s.

    Returns:
        What is wrong with it and what to do; empty if nothing is found.
    """
    if not link.connect:
        return ""
    end = Endpoint.parse(link.connect[0])
    try:
        with _reach(end, patience) as plain:
            return _shake_hands(plain, link, end) if end.is_secure else ""
    except socket.gaierror:
        return f"{end.text}: no host is called {end.host}"
    except TimeoutError:
        return f"{end.text}: {end.host} does not answer within {patience:g} s: is it on, and reachable from here?"
    except (ConnectionRefusedError, FileNotFoundError):
        return f"{end.text}: nothing listens there: is the robot, or its router, up?"
    except OSError as error:
        return f"{end.text}: {error.strerror or error}"


def _reach(end: Endpoint, patience: float) -> socket.socket:
    if end.protocol != "unixsock-stream":
        return socket.create_connection((end.host, end.port), patience)
    plain = socket.socket(socket.AF_UNIX)
    plain.settimeout(patience)
    try:
        plain.connect(end.host)
    except BaseException:
        plain.close()
        raise
    return plain


def _shake_hands(plain: socket.socket, link: Link, end: Endpoint) -> str:
    """Try a TLS handshake: why one side refuses the other's certificate, as text; empty for no refusal."""
    assert link.credentials is not None and link.identity is not None
    own = link.credentials / f"{link.identity}.pem"
    try:
        context = ssl.create_default_context(cafile=str(link.credentials / "ca.pem"))
        context.load_cert_chain(own, link.credentials / f"{link.identity}-key.pem")
        with context.wrap_socket(plain, server_hostname=end.host) as secure, contextlib.suppress(TimeoutError):
            secure.settimeout(0.3)  # TLS 1.3: the other side's verdict on our certificate comes after the handshake
            secure.recv(1)
    except ssl.SSLCertVerificationError as error:
        return (
            f"{end.text}: the certificate shown there is refused: {error.verify_message}; it must be made by the same "
            f"`navloom keys new` as {own}, with --host {end.host}"
        )
    except ssl.SSLError as error:
        reason = error.reason or ""
        words = next((words for part, words in _WORDS.items() if part in reason), "TLS fails: {reason}")
        return f"{end.text}: {words.format(own=own, reason=reason or error)}"
    return ""
