"""Wall clocks of a lab's hosts that can be set while everything runs, as by an operator; monotonic clocks go on."""

from __future__ import annotations

import shutil
import struct
import subprocess
from pathlib import Path

from host_rig import Lab

__all__ = ["WallClocks", "why_no_clocks"]


def why_no_clocks() -> str:
    """Why wall clocks cannot be set here; empty where they can."""
    return "" if shutil.which("cc") else "no C compiler `cc`, which the settable wall clock is built with"


class WallClocks:
    """Gives each host a wall clock of its own. Made before anything is started on them.

    Args:
        lab: The hosts.
    """

    def __init__(self, lab: Lab) -> None:
        self._folder = lab.folder
        library = lab.folder / "wall_clock.so"
        source = Path(__file__).with_name("wall_clock.c")
        subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", str(library), str(source), "-lm"], check=True)
        for name, host in lab.hosts.items():
            self.set(name, 0.0)
            host.environment |= {"LD_PRELOAD": str(library), "WALL_CLOCK_OFFSET": str(self._offset(name))}

    def set(self, host: str, ahead: float) -> None:
        """Set a host's wall clock to this many s ahead of the machine's."""
        with self._offset(host).open("r+b" if self._offset(host).exists() else "wb") as file:
            file.write(struct.pack("d", ahead))

    def _offset(self, host: str) -> Path:
        return self._folder / f"{host}.offset"
