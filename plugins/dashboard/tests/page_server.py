"""A server of the page's websockets that says what a test wants, among it names and texts with markup."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from playwright.sync_api import Page, WebSocketRoute

__all__ = ["COMMANDS", "EVENT", "MARKUP", "POSE", "ROBOT", "Server", "about", "state"]

MARKUP = '<img src=x onerror="window.broken = 1"><script>window.broken = 1</script>'
ROBOT = "lab/r1"
PARAMETERS = [
    {"name": "k1", "value": 1.0, "default": 1.0, "min": 0.0, "max": 5.0, "type": "number", "unit": "1/s"},
    {"name": "kind", "value": "a", "default": "a", "choices": ["a", "b"], "type": "string", "meaning": MARKUP},
    {"name": "deep", "value": True, "default": None, "type": "boolean"},
]  # fmt: skip
EVENT = {
    "kind": "event", "age": 0, "id": 1, "time": "2026-01-01T00:00:00Z", "level": "warning", "code": MARKUP,
    "text": MARKUP, "remedy": f"`{MARKUP}`",
}  # fmt: skip
COMMANDS = {"kind": "commands", "age": 0, "roles": {"avoider": [
    {"instance": MARKUP, "active": True, "v": 0.1, "w": 0.0}, {"instance": "b", "active": False, "v": 0, "w": 0},
]}}  # fmt: skip
LIMITS = {"v": 0.8, "w": 1.0}
POSE = {"kind": "pose", "age": 0.0, "x": 0.0, "y": 0.0, "heading": 0.0, "cov": None, "state": "tracking", "reason": ""}


def about(instance: str = "vfh") -> dict[str, Any]:
    nodes = [{"instance": instance, "plugin": "vfh", "active": True, "enabled": True, "fault": ""}]
    square = [[0.2, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.2, -0.2]]
    return {
        "kind": "robot",
        "age": None,
        "name": ROBOT,
        "footprint": square,
        "limits": LIMITS,
        "roles": {"avoider": nodes},
    }


def state(**fields: Any) -> dict[str, Any]:
    driving = {"driver": "avoider vfh drives", "stopped": False, "latched": False, "at_rest": False}
    quiet = {"why": "", "remedy": "", "goal": None, "limit": None, "v": 0.0, "w": 0.0}
    return {"kind": "state", "age": 0.0, **driving, **quiet, **fields}


class Server:
    """What the page's websockets are connected to.

    Attributes:
        page: The page.
        live, stop, teleop: Its newest connection of each kind; None before the first.
        said: What the page has sent over `stop` and `teleop`, in order.
        asked: Its questions how long the way is.
        acknowledges: Whether the server answers stops and heartbeats.
    """

    def __init__(self, page: Page) -> None:
        self.page = page
        self.live: WebSocketRoute | None = None
        self.stop: WebSocketRoute | None = None
        self.teleop: WebSocketRoute | None = None
        self.said: list[dict[str, Any]] = []
        self.asked: list[dict[str, Any]] = []
        self.acknowledges = True
        page.route_web_socket("**/ws/**", self._open("live"))
        page.route_web_socket("**/stop/**", self._open("stop"))
        page.route_web_socket("**/teleop/**", self._open("teleop"))
        answers = {
            "session": {"right": "operate", "csrf": "", "robots": [ROBOT, f"lab/{MARKUP}"]},
            "recordings": {"recordings": [{"name": "lab_r1_1.mcap", "bytes": 1e6}], "recording": False},
            "doctor": {"healthy": False, "findings": [{"severity": "problem", "what": MARKUP, "remedy": MARKUP}]},
            "params": {"nodes": [{"node": "avoider vfh", "params": PARAMETERS}]},
        }
        page.route("**/api/**", lambda route: route.fulfill(json=answers[route.request.url.rpartition("/")[2]]))

    def _open(self, kind: str) -> Callable[[WebSocketRoute], None]:
        def open_one(socket: WebSocketRoute) -> None:
            setattr(self, kind, socket)
            if kind == "stop":
                socket.on_message(self._hear_stop)
                socket.send(json.dumps({"heartbeat": True}))
            elif kind == "teleop":
                socket.on_message(lambda text: self.said.append(json.loads(text)))
            else:
                socket.on_message(lambda text: self.asked.append(json.loads(text)))
                self.send(about(), POSE, state())

        return open_one

    def _hear_stop(self, text: str | bytes) -> None:
        said = json.loads(text)
        if "n" in said:
            self.said.append(said)
        if self.stop is not None and self.acknowledges:
            self.stop.send(json.dumps({"n": said["n"], "sent": True} if "n" in said else {"heartbeat": True}))

    def send(self, *messages: dict[str, Any]) -> None:
        """Send what a robot says."""
        assert self.live is not None
        for message in messages:
            self.live.send(json.dumps(message))
