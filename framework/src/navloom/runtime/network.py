"""How the processes of a robot find each other: by sockets on one host, or through a router."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from navloom.config.schema import Config
from navloom.runtime.directory import RobotFolder
from navloom.runtime.links import Endpoint, Link, LinkError, certificate, peer_link, settings
from navloom.runtime.quality import streams_of

__all__ = ["Network", "network_of"]


@dataclass
class Network:
    """Of one robot.

    Attributes:
        realm, robot: Its names.
        router: Endpoint of its router; empty where its processes join each other directly.
        starts_router: The router belongs to this host.
        keys: Folder of certificates, or the file of the one that processes of this host show.
        insecure: Plain TCP beyond this host was asked for.
        streams: Of the robot, as role/instance/port.
    """

    realm: str
    robot: str
    router: str = ""
    starts_router: bool = False
    keys: Path | None = None
    insecure: bool = False
    streams: tuple[str, ...] = ()

    @property
    def folder(self) -> Path | None:
        """Of the certificates."""
        return certificate(self.keys, "nodes")[0]

    def check(self) -> None:
        """Refuse what no process could be linked by, before any is started. Raises LinkError."""
        if self.router:
            for link in (self.router_link(), self._client("nodes")):
                if link is not None:
                    settings(link)

    def links(self, folder: RobotFolder, names: Sequence[str]) -> dict[str, Link]:
        """Of each process: to every other one's socket, or to the router."""
        if self.router:
            return {name: self._client("nodes") for name in names}
        sockets = {name: folder.socket(name) for name in names}
        return {name: peer_link(own, sockets.values(), self.realm, self.robot) for name, own in sockets.items()}

    def router_link(self) -> Link | None:
        """Of the router, where it is this host's to start."""
        if not self.starts_router:
            return None
        folder = self.folder
        return Link(
            "router", (self.router,), (), credentials=folder, identity="router" if folder else None,
            insecure=self.insecure, realm=self.realm, robot=self.robot, streams=self.streams,
        )  # fmt: skip

    def outsider(self, folder: RobotFolder, names: Sequence[str], identity: str = "operator") -> Link:
        """Of a tool on the same host, which nobody needs to find."""
        if self.router:
            return replace(self._client(identity), shared_memory=False)
        sockets = tuple(folder.socket(name) for name in names)
        return Link("peer", (), sockets, realm=self.realm, robot=self.robot, shared_memory=False)

    def tool(self) -> Link:
        """Of a tool beside whatever runs now: it calls the router, or every socket that is there."""
        if self.router:
            return self._client("nodes")
        sockets = tuple(RobotFolder(self.realm, self.robot).sockets())
        return Link("peer", (), sockets, realm=self.realm, robot=self.robot)

    def _client(self, identity: str) -> Link:
        folder, own = certificate(self.keys, "nodes")
        shown = own if identity == "nodes" or folder is None else identity
        return Link(
            "client", (), (self.router,), credentials=folder, identity=shown,
            insecure=self.insecure, realm=self.realm, robot=self.robot,
        )  # fmt: skip


def network_of(config: Config, host: str | None, insecure: bool) -> Network:
    """The network a config asks for. Raises LinkError for a router that is no endpoint."""
    live = config.live
    if live.router:
        try:
            Endpoint.parse(live.router)
        except LinkError as error:
            raise LinkError(f"live.router: {error}") from None
    keys = Path(live.keys) if live.keys else None
    starts = live.router is not None and live.router_host == host
    return Network(config.robot.realm, config.robot.name, live.router or "", starts, keys, insecure, streams_of(config))
