"""A dashboard for tests, served on a free port of loopback, and browsers that do what ours would not."""

from __future__ import annotations

import http.client
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from navloom_dashboard.app import Dashboard
from navloom_dashboard.robot_link import Where
from navloom_live import WebServer, guarded
from websockets.sync.client import ClientConnection, connect

WAIT = 60.0
"""Longest wait for an event, s."""


class Answer(NamedTuple):
    """An answer: status, headers, and its JSON object, or its text."""

    status: int
    headers: Mapping[str, str]
    body: Any


class Browser:
    """Sends requests as a browser does, with the session's cookie and token, unless told otherwise."""

    def __init__(self, port: int) -> None:
        self.port, self.cookie, self.csrf = port, "", ""

    @property
    def origin(self) -> str:
        """Origin of the dashboard's own page."""
        return f"http://127.0.0.1:{self.port}"

    def ask(self, path: str, body: Any = None, method: str | None = None, **headers: str) -> Answer:
        """Send a request; headers are given with _ for -, and replace the usual ones."""
        given = {"Host": f"127.0.0.1:{self.port}", "Cookie": self.cookie, "X-CSRF-Token": self.csrf}
        if body is not None:
            given |= {"Content-Type": "application/json", "Origin": self.origin}
        given |= {name.replace("_", "-"): value for name, value in headers.items()}
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=WAIT)
        try:
            data = body if isinstance(body, (bytes, type(None))) else json.dumps(body).encode()
            method = method or ("GET" if body is None else "POST")
            connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
            for name, value in given.items():
                if value:
                    connection.putheader(name, value)
            if data is not None:
                connection.putheader("Content-Length", str(len(data)))
            connection.endheaders(data)
            answer = connection.getresponse()
            text = answer.read()
            kind = answer.headers.get("content-type", "")
            return Answer(answer.status, answer.headers, json.loads(text) if "json" in kind else text)
        finally:
            connection.close()

    def login(self, token: str) -> Answer:
        """Log in, and keep the session if it was opened."""
        answer = self.ask("/api/login", {"token": token})
        if answer.status == 200:
            self.cookie, self.csrf = answer.headers["set-cookie"].split(";")[0], answer.body["csrf"]
        return answer

    def act(self, act: str, /, **fields: Any) -> Answer:
        """Send an act to the robot lab/r1."""
        return self.ask("/api/lab/r1/act", {"act": act, **fields})

    def socket(self, path: str, origin: str = "", **settings: Any) -> ClientConnection:
        """Open a websocket, with settings of `connect`."""
        given = {"max_size": None, "max_queue": None, "legacy": True, **settings}
        if self.cookie:
            given["additional_headers"] = {"Cookie": self.cookie}
        return connect(f"ws://127.0.0.1:{self.port}{path}", origin=origin or self.origin, **given)


class Served(NamedTuple):
    """A dashboard that is served."""

    dashboard: Dashboard
    server: WebServer

    @property
    def port(self) -> int:
        """Its port."""
        return self.server.port

    def browser(self, right: str = "") -> Browser:
        """A browser; with a right, it has logged in."""
        browser = Browser(self.port)
        if right:
            assert browser.login(self.dashboard.sessions.tokens[right]).status == 200  # type: ignore[index]
        return browser


@contextmanager
def served(recordings: Path, *robots: str) -> Iterator[Served]:
    """A dashboard of some robots."""
    server = WebServer(("127.0.0.1", 0), websockets=True)
    dashboard = Dashboard(
        lambda: {name: Where(name) for name in robots}, recordings, f"navloom-{server.port}", is_secure=False
    )
    server.start(guarded(dashboard.app, ()))
    try:
        yield Served(dashboard, server)
    finally:
        server.close()


def frames(socket: ClientConnection, kind: str, count: int = 1) -> list[dict[str, Any]]:
    """The next frames of a kind; binary ones with their `bytes`."""
    found: list[dict[str, Any]] = []
    while len(found) < count:
        data = socket.recv(timeout=WAIT)
        if isinstance(data, bytes):
            size = int.from_bytes(data[:4], "little")
            frame = {**json.loads(data[4 : 4 + size]), "bytes": data[4 + size :]}
        else:
            frame = json.loads(data)
        if frame["kind"] == kind:
            found.append(frame)
    return found
