"""Faults on this host: stale folders of dead robots, orphans, and processes that do not stay up."""

from __future__ import annotations

import contextlib
from collections.abc import Container

from navloom_live.hosting.descendants import Descendant, descendants, status_of
from navloom_live.hosting.runtime_folders import Fate, RobotFolder, runtime_folder
from navloom_live.operating.health_findings import Finding

__all__ = ["fate_in_words", "is_stopped", "left_behind", "left_running", "restarting", "strays"]


def left_behind() -> list[Finding]:
    """Stale folders of robots that are no longer up. The next `navloom up` of that robot removes its folder."""
    found = []
    for path in sorted(runtime_folder().glob("*.*/robot.json")):
        realm, _, robot = path.parent.name.partition(".")
        folder = RobotFolder(realm, robot)
        told = folder.told()
        if told is None:
            what = f"{path} cannot be read"
        elif folder.read() is None:
            what = (
                f"robot {realm}/{robot} died without a shutdown: its process {told.pid} is gone, but its folder remains"
            )
        else:
            continue
        found.append(Finding("note", what, f"`rm -r {path.parent}`; `navloom up` of that robot does it too"))
    return found


def strays(robot: str | None = None) -> dict[str, list[Descendant]]:
    """Orphans of this user's robots, whose `navloom up` is gone, by REALM/NAME; for one robot or all."""
    found: dict[str, list[Descendant]] = {}
    for descendant in descendants():
        realm, _, name = descendant.folder.name.partition(".")
        is_wanted = robot in (None, name, f"{realm}/{name}")
        if descendant.is_left and descendant.folder.parent == runtime_folder() and is_wanted:
            found.setdefault(f"{realm}/{name}", []).append(descendant)
    return found


def left_running() -> list[Finding]:
    """Findings for orphans of robots that are down."""
    return [
        Finding(
            "problem",
            f"{', '.join(map(str, left))}: still running, although robot {robot} is down",
            f"`navloom down --robot {robot}` ends them, and so does the next `navloom up` of that robot",
        )
        for robot, left in strays().items()
    ]


def restarting(folder: RobotFolder, told: Container[str]) -> list[Finding]:
    """Findings for processes of a robot on this host that were restarted or have failed.

    Args:
        folder: Folder of the robot.
        told: Processes that already have a finding.
    """
    found = []
    for name, fate in folder.fates().items():
        if fate.state == "failed" and name not in told:
            what, remedy = fate_in_words(folder, name, fate)
            found.append(Finding("problem", f"process {name}: {what}", remedy))
        elif fate.restarts and fate.state == "running":
            times = "once" if fate.restarts == 1 else f"{fate.restarts} times"
            what = f"process {name} was restarted {times}: it {fate.why}"
            found.append(Finding("note", what, f"see {folder.path / f'{name}.log'}"))
        if fate.cut:
            what = f"process {name} writes so much that {fate.cut * 1e-6:.1f} MB of its log were dropped"
            found.append(Finding("note", what, f"have its plugins print less; see {folder.path / f'{name}.log'}"))
    return found


def fate_in_words(folder: RobotFolder, process: str, fate: Fate) -> tuple[str, str]:
    """State of a process in words, and the remedy."""
    log = folder.path / f"{process}.log"
    if fate.state == "running":
        if fate.pid is not None and is_stopped(fate.pid):
            return f"it is suspended (pid {fate.pid})", f"`kill -CONT {fate.pid}` continues it"
        again = f"`kill -KILL {fate.pid}` makes `navloom up` restart it"
        return f"it runs (pid {fate.pid}) but is not ready, or hangs", f"see {log}; {again}"
    said = folder.last_words(process)
    what = f"it {fate.why}" + (f" and its last message was: {said}" if said else "")
    if fate.state == "failed":
        return f"{what}; it stays down", "fix what it reports, then `navloom down` and `navloom up`"
    return what, f"`navloom up` restarts it; its log is {log}"


def is_stopped(pid: int) -> bool:
    """Whether a process of this host is suspended, by Ctrl-Z or SIGSTOP."""
    with contextlib.suppress(OSError, IndexError):
        return status_of(pid)[1] in ("T", "t")
    return False
