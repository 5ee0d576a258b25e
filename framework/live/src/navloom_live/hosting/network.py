"""How the processes of a robot find each other: by sockets on one host, or through a router."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from navloom.config.schema import Config
from navloom.engine.catalogue import catalogue_of
from navloom.engine.streams import STEP

from navloom_live.hosting.runtime_folders import RobotFolder
from navloom_live.live.live_node import Source
from navloom_live.transport.keyspace import FAULT, SUPERVISOR
from navloom_live.transport.links import Endpoint, Link, LinkError, Mesh, certificate, peer_link, settings
from navloom_live.transport.quality_of_service import PARAMETERS

__all__ = ["Network", "network_of", "streams_of"]


@dataclass
class Network:
    """Network settings of one robot.

    Attributes:
        realm, robot: Its names.
        router: Endpoint of its router; empty if its processes connect directly.
        starts_router: This host starts the router.
        keys: Folder of certificates, or the file of the certificate that processes of this host use.
        insecure: Plain TCP to other hosts is allowed.
        streams: Streams of the robot, as role/instance/port.
        is_whole: All of the robot's processes are on this host.
        shared_memory: Large messages between its processes on one host use shared memory.
    """

    realm: str
    robot: str
    router: str = ""
    starts_router: bool = False
    keys: Path | None = None
    insecure: bool = False
    streams: tuple[str, ...] = ()
    is_whole: bool = True
    shared_memory: bool = False

    @property
    def folder(self) -> Path | None:
        """Folder of the certificates; None for none."""
        return certificate(self.keys, "nodes")[0]

    def check(self) -> None:
        """Refuse settings with which no process could join, before any is started. Raises LinkError."""
        if self.router:
            for link in (self.router_link(), self.alone()):
                if link is not None:
                    # Made and thrown away: it reads the certificates, so that a wrong file is told before any process
                    # starts.
                    settings(link)

    def links(self, folder: RobotFolder, shares: Mapping[str, Sequence[Source]]) -> dict[str, Link]:
        """Link of each process of this host: to every other one's socket, and to the router if there is one."""
        sockets = {name: folder.socket(name) for name in shares}
        meshed = {
            name: peer_link(own, sockets.values(), self.realm, self.robot, self.shared_memory)
            for name, own in sockets.items()
        }
        if not self.router:
            return meshed
        return {name: self._beside(link, shares) for name, link in meshed.items()}

    def added(self, folder: RobotFolder, shares: Mapping[str, Sequence[Source]], name: str) -> Link:
        """Link of a process that is added to the running ones: it connects to all of them and to their supervisor, and
        none connects to it.

        Args:
            folder: The robot's folder.
            shares: All processes of this host, the new one included.
            name: Name of the new one.
        """
        own = folder.socket(name)
        others = tuple(sorted(folder.socket(other) for other in (*shares, SUPERVISOR) if other != name))
        link = Link(
            "peer", (own,), others, realm=self.realm, robot=self.robot, peers=len(others),
            shared_memory=self.shared_memory,
        )  # fmt: skip
        return self._beside(link, shares) if self.router else link

    def router_link(self) -> Link | None:
        """Link of the router, if this host starts it."""
        if not self.starts_router:
            return None
        folder = self.folder
        return Link(
            "router", (self.router,), (), credentials=folder, identity="router" if folder else None,
            insecure=self.insecure, realm=self.realm, robot=self.robot, streams=self.streams,
        )  # fmt: skip

    def outsider(self, folder: RobotFolder, shares: Mapping[str, Sequence[Source]]) -> Link:
        """Link of the supervisor of this host's processes, which listens for tools and for processes added later."""
        sockets = tuple(folder.socket(name) for name in shares)
        link = Link("peer", (folder.socket(SUPERVISOR),), sockets, realm=self.realm, robot=self.robot)
        return self._beside(link, shares) if self.router else link

    def alone(self) -> Link:
        """Link of a process that reaches all others through the router."""
        folder, own = certificate(self.keys, "nodes")
        return Link(
            "client", (), (self.router,), credentials=folder, identity=own,
            insecure=self.insecure, realm=self.realm, robot=self.robot,
        )  # fmt: skip

    def _beside(self, link: Link, shares: Mapping[str, Sequence[Source]]) -> Link:
        """Link of a process that reaches those of its host by sockets, and all others through the router."""
        here = [f"{role}/{name}" for sources in shares.values() for role, name in sources]
        here += [f"process/{name}" for name in shares]
        return replace(self.alone(), mesh=Mesh(link, tuple(here), self.is_whole))

    def tool(self) -> Link:
        """Link of a tool: to the router, or to every socket that exists now."""
        if self.router:
            return self.alone()
        sockets = tuple(RobotFolder(self.realm, self.robot).sockets())
        return Link("peer", (), sockets, realm=self.realm, robot=self.robot)


def network_of(config: Config, host: str | None, insecure: bool) -> Network:
    """The network settings of a config. Raises LinkError if `live.router` is no endpoint."""
    live = config.live
    if live.router:
        try:
            Endpoint.parse(live.router)
        except LinkError as error:
            raise LinkError(f"live.router: {error}") from None
    keys = Path(live.keys) if live.keys else None
    starts = live.router is not None and live.router_host == host
    is_whole = host is None or set(live.hosts.get(host, ())) == set(live.processes)
    return Network(
        config.robot.realm, config.robot.name, live.router or "", starts, keys, insecure, streams_of(config), is_whole,
        live.shared_memory,
    )  # fmt: skip


def streams_of(config: Config) -> tuple[str, ...]:
    """Every stream that a robot may have, as role/instance/port, sorted. Nodes that are not installed have none."""
    catalogue, _ = catalogue_of(config)
    instances = [(role, table.instance) for _, role, table in config.role_tables()]
    instances += [(port.role, "main") for port in catalogue.ports() if port.role not in config.roles]
    found = {f"{role}/{name}/{port}" for role, name in instances for port in (PARAMETERS, STEP, FAULT)}
    found |= {f"{role}/{name}/{port.name}" for role, name in instances for port in catalogue.ports(role)}
    found |= {f"platform/{config.platform.instance}/{sensor.name}" for sensor in config.sensor}
    return tuple(sorted(found))
