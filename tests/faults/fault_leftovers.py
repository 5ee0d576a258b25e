"""Faults that may leave processes or files over: plugins that fork, and a runtime folder that is deleted."""

from __future__ import annotations

import os
import shutil
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fault_kinds import AGAIN, STOP, Fault
from fault_rig import SHARES, Rig, until
from leftovers import below
from navloom_live.hosting import fork_server

__all__ = ["DELETIONS", "FORKS", "WAYS", "fork_first", "forks", "zombies"]

WAYS = {
    "fork": "has forked",
    "daemon": "has forked a daemon",
    "pool": "has a pool of processes",
    "stray": "goes on in a fork",
}
"""How a plugin creates children: order of `fault_plugins.fail` -> words in the fault's name."""
PLUGIN = "faulty_tracker"
REAPED = 3.0
"""Longest time until children that have ended must be reaped, on a loaded machine, s."""
STRAY = 0.5
"""Time for a plugin to fork a child that continues as the node, s."""


def forks(rig: Rig) -> list[int]:
    """Descendants of a robot that are not its own processes."""
    own = {rig.up.pid, *rig.pids().values(), *rig.outsiders()}
    return [pid for pid in below(rig.folder) if pid not in own and not _is_nursery(pid)]


def _is_nursery(pid: int) -> bool:
    """Whether a process is the nursery itself; a process forked from it takes another name."""
    try:
        name = Path(f"/proc/{pid}/comm").read_text("utf-8")
        return name.startswith("python") and fork_server.__name__.encode() in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return True


def fork_first(way: str) -> Callable[[Rig], None]:
    """Make the controller create children, and wait until they run."""

    def prepare(rig: Rig) -> None:
        told = rig.tell(PLUGIN, way)
        if way == "stray":
            time.sleep(STRAY)  # the child may end before it can be seen
        else:
            until(lambda: forks(rig), AGAIN, "the plugin has made a child")
        told.unlink()

    return prepare


def _kill(share: str) -> Callable[[Rig], None]:
    return lambda rig: os.kill(rig.pids()[share], signal.SIGKILL)


def _children(rig: Rig) -> dict[str, Any]:
    """Children that run, and zombies that `up` has not reaped within REAPED."""
    limit = time.monotonic() + REAPED
    while zombies(rig) and time.monotonic() < limit:
        time.sleep(0.05)
    return {"children": [_describe(pid) for pid in forks(rig)], "zombies": len(zombies(rig))}


def _describe(pid: int) -> str:
    """Name, state, parent, group and session of a process."""
    try:
        return " ".join(Path(f"/proc/{pid}/stat").read_text("utf-8").split()[:6])
    except OSError:
        return ""


def zombies(rig: Rig) -> list[str]:
    """Children of `up` that have not been reaped."""
    found = []
    for name in filter(str.isdigit, os.listdir("/proc")):
        try:
            state, parent = Path(f"/proc/{name}/stat").read_text("utf-8").rpartition(")")[2].split()[:2]
        except OSError:
            continue
        if state == "Z" and int(parent) == rig.up.pid:
            found.append(name)
    return found


FORKS = [
    Fault(f"{PLUGIN} {words}, SIGKILL drive", _kill("drive"), prepare=fork_first(way), look=_children, hold=0.5)
    for way, words in WAYS.items()
]
"""A process is killed while its plugin has children."""


def delete_folder(rig: Rig) -> None:
    """Delete the runtime folder with all sockets."""
    shutil.rmtree(rig.folder / "rt", ignore_errors=True)  # `up` may create it again before it is empty


def _delete_and_kill(share: str) -> Callable[[Rig], None]:
    def begin(rig: Rig) -> None:
        delete_folder(rig)
        until(lambda: share in rig.pids(), STOP, "the folder is there again")
        os.kill(rig.pids()[share], signal.SIGKILL)

    return begin


def _status(rig: Rig) -> dict[str, Any]:
    """Whether commands find the robot."""
    done = rig.run("status", "--json")
    return {"status": done.returncode}


DELETIONS = [
    Fault("runtime folder deleted", delete_folder, stops=False, look=_status),
    *(
        Fault(f"runtime folder deleted, SIGKILL {share}", _delete_and_kill(share), is_platform=share == "robot")
        for share in SHARES
    ),
]
"""The runtime folder of a driving robot is deleted."""
