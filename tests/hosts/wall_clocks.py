"""Wall clocks of a lab's hosts that can be set while everything runs; monotonic clocks are not affected."""

from __future__ import annotations

import shutil
import struct
import subprocess
from pathlib import Path

from host_rig import Lab

__all__ = ["WallClocks", "settable_clock", "set_clock", "why_no_clocks"]


def why_no_clocks() -> str:
    """Why wall clocks cannot be set here; empty if they can."""
    return "" if shutil.which("cc") else "no C compiler `cc`, which the settable wall clock is built with"


def settable_clock(library: Path, offset: Path) -> dict[str, str]:
    """Environment of processes whose wall clock `set_clock` sets.

    Args:
        library: Library to build; reused if it exists.
        offset: File with the offset of the clock.
    """
    if not library.exists():
        source = Path(__file__).with_name("wall_clock.c")
        subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", str(library), str(source), "-lm"], check=True)
    set_clock(offset, 0.0)
    return {"LD_PRELOAD": str(library), "WALL_CLOCK_OFFSET": str(offset)}


def set_clock(offset: Path, ahead: float) -> None:
    """Set a wall clock to this many s ahead of the machine's."""
    with offset.open("r+b" if offset.exists() else "wb") as file:
        file.write(struct.pack("d", ahead))


class WallClocks:
    """Gives each host its own wall clock. Create it before any process of the hosts.

    Args:
        lab: The hosts.
    """

    def __init__(self, lab: Lab) -> None:
        self._folder = lab.folder
        for name, host in lab.hosts.items():
            host.environment |= settable_clock(lab.folder / "wall_clock.so", self._offset(name))

    def set(self, host: str, ahead: float) -> None:
        """Set a host's wall clock to this many s ahead of the machine's."""
        set_clock(self._offset(host), ahead)

    def _offset(self, host: str) -> Path:
        return self._folder / f"{host}.offset"
