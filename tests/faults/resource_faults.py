"""Faults of shared resources: memory, processors, descriptors, disk, wall clock; and forged commands."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from fault_kinds import Fault, answer, order, tell, untell
from fault_rig import Rig, rig, until
from outsider import MARK

sys.path.insert(0, str(Path(__file__).parents[1] / "hosts"))
from wall_clocks import set_clock, settable_clock, why_no_clocks

__all__ = ["FULL_DISK", "RESOURCES", "rig_on_small_disk", "rig_with_clock", "why_not"]

GROUPS = Path("/sys/fs/cgroup/memory")
"""Memory limits of the system, where it has version 1 of control groups."""
MEMORY = 500 * 2**20
"""Memory limit of the process that eats memory, bytes: about twice what it normally uses."""
DISK = 8
"""Size of the small disk, MB."""
HOGGED, JUMPED, FORGED, FULL = 10.0, 3.0, 7.0, 5.0
"""Times of observation, s: with busy processors, after a clock's jump, from a forgery's start, with a full disk."""
JUMPS = {"an hour ahead": 3600.0, "an hour back": -3600.0, "ten years ahead": 315_360_000.0, "right again": 0.0}


def why_not() -> str:
    """Why these faults cannot be injected here; empty if they can."""
    if os.geteuid() != 0:
        return "a small disk and a limit of memory need root"
    return why_no_clocks() or ("" if GROUPS.is_dir() else f"{GROUPS} is not there, which a limit of memory needs")


# --- memory, descriptors, processors, clock ---------------------------------------------------------------------------


def _eat(rig: Rig) -> None:
    """Make the avoider allocate memory until the system kills its process."""
    group = GROUPS / rig.folder.name
    group.mkdir(exist_ok=True)
    (group / "memory.limit_in_bytes").write_text(str(MEMORY), "utf-8")
    (group / "cgroup.procs").write_text(str(rig.pids()["drive"]), "utf-8")
    tell("faulty_vfh", "eat")(rig)


def _stop_eating(rig: Rig) -> None:
    untell("faulty_vfh", "eat")(rig)
    members = GROUPS / rig.folder.name / "cgroup.procs"
    until(lambda: not members.read_text("utf-8"), 10.0, "the process that ate has ended")
    members.parent.rmdir()


def _take_descriptors(rig: Rig) -> None:
    """Use up the descriptors of the process `drive`, and kill the gate, which must connect to `drive` again."""
    tell("faulty_vfh", "open")(rig)
    until(lambda: descriptors_left(rig.pids()["drive"]) <= 0, 5.0, "every descriptor is taken")
    os.kill(rig.pids()["safe"], signal.SIGKILL)


def descriptors_left(pid: int) -> int:
    """Number of descriptors that a process may still open."""
    limits = Path(f"/proc/{pid}/limits").read_text("utf-8").splitlines()
    limit = next(int(line.split()[3]) for line in limits if line.startswith("Max open files"))
    return limit - len(os.listdir(f"/proc/{pid}/fd"))


def _hog(rig: Rig) -> None:
    """Keep every processor busy for a while, at normal priority."""
    command = [
        sys.executable,
        "-c",
        f"import time; end = time.monotonic() + {HOGGED}\nwhile time.monotonic() < end: pass",
    ]
    hogs = [subprocess.Popen(command) for _ in range(os.cpu_count() or 1)]
    for hog in hogs:
        hog.wait(3 * HOGGED)


def _jump(ahead: float) -> Callable[[Rig], None]:
    return lambda rig: set_clock(rig.folder / "clock", ahead)


def forged_words(rig: Rig) -> dict[str, Any]:
    """Forged motor commands and stops, so far."""
    words = sum(word.wz == MARK for word in rig.motors.look().words)
    stops = sum(line.startswith("stopped:") for line in rig.log.read_text("utf-8").splitlines())
    return {"forged words": words, "stops": stops}


RESOURCES = [
    Fault("faulty_vfh eats memory until the system ends its process", _eat, _stop_eating, hold=0.5),
    Fault("no descriptor left in drive, SIGKILL safe", _take_descriptors, untell("faulty_vfh", "open"), hold=3.0),
    Fault("a hog on each processor", _hog, stops=False, watch=0.0, look=forged_words),
    *(Fault(f"the wall clock is set {name}", _jump(ahead), stops=False, watch=JUMPED, look=forged_words)
      for name, ahead in JUMPS.items()),
    Fault("forged commands within the limits", order("forge", "go"), answer("forge"), stops=False, watch=FORGED,
          look=forged_words, prepare=lambda rig: rig.outsider("forge")),
]  # fmt: skip
"""Faults of shared resources; one robot takes many of them."""


def rig_with_clock(folder: Path, more: str) -> Rig:
    """A robot whose wall clock can be set."""
    return Rig(folder, more, settable_clock(folder / "wall_clock.so", folder / "clock"))


# --- a full disk ------------------------------------------------------------------------------------------------------


@contextmanager
def rig_on_small_disk() -> Iterator[Rig]:
    """A robot with runtime folder, logs and recording on a small disk."""
    mounted: list[Path] = []

    def make(folder: Path, more: str) -> Rig:
        disk = folder / "rt"
        disk.mkdir()
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={DISK}m", "none", str(disk)], check=True)
        mounted.append(disk)
        return Rig(folder, more, arguments=("--record", str(disk / "drive.mcap")))

    try:
        with rig(make=make) as robot:
            yield robot
    finally:
        for disk in mounted:
            subprocess.run(["umount", "-l", str(disk)], check=False)


def _fill(rig: Rig) -> None:
    """Leave no byte of it, and go on: what is deleted meanwhile is taken as well."""
    with suppress(OSError), (rig.folder / "rt" / "filler").open("ab", buffering=0) as file:
        while True:
            file.write(bytes(4096))


def _fill_and_kill(share: str) -> Callable[[Rig], None]:
    def begin(rig: Rig) -> None:
        _fill(rig)
        os.kill(rig.pids()[share], signal.SIGKILL)

    return begin


def _empty(rig: Rig) -> None:
    (rig.folder / "rt" / "filler").unlink()


FULL_DISK = [
    Fault("the disk of folder, logs and recording is full", _fill, _empty, stops=False, watch=FULL, look=forged_words),
    Fault("the disk is full, SIGKILL drive", _fill_and_kill("drive"), _empty, hold=5.0),
    Fault("the disk is full, SIGKILL safe", _fill_and_kill("safe"), _empty, hold=5.0),
]
"""Each trial starts a new robot."""
