"""Entry of a node process: `python -m navloom.runtime.node_main FILE`, with what it is to do in the file."""

from __future__ import annotations

import ctypes
import json
import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any

from navloom.config.loader import Loaded
from navloom.runtime.build import assemble
from navloom.runtime.links import Link
from navloom.runtime.node_process import NodeProcess, Share, leave

__all__ = [
    "die_with_parent",
    "end_on_signal",
    "link_from_json",
    "link_to_json",
    "main",
    "share_from_json",
    "share_to_json",
]

PR_SET_PDEATHSIG = 1
GRACE = 4.0
"""s a process that was told to end may take; then it ends at once."""


def main() -> int:
    """Run the share of a file until told to end. Exit codes: 0 told to, 1 failed, 2 wrong request, 70 a node hung."""
    spec = json.loads(Path(sys.argv[1]).read_text("utf-8"))
    die_with_parent(int(spec["parent"]))
    sys.setswitchinterval(0.0005)  # a control node must not wait 5 ms for a neighbour that computes
    process = NodeProcess(assemble(Loaded.from_json(spec["loaded"])), share_from_json(spec["share"]))
    end_on_signal(process.ending)
    name = process.share.name
    try:
        process.run(lambda text: print(f"{name}: {text}", flush=True), lambda: print(f"{name}: ready", flush=True))
    except Exception as error:
        print(f"{name}: {type(error).__name__}: {error}", file=sys.stderr, flush=True)
        return 2 if isinstance(error, (ValueError, OSError)) else 1
    if process.hung:
        print(f"{name}: {process.hung}", file=sys.stderr, flush=True)
    return leave(process)


def die_with_parent(parent: int) -> None:
    """Have the system tell this process to end when its parent dies, however that dies."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # it died before that
        os._exit(1)


def end_on_signal(ending: threading.Event) -> None:
    """End in order on SIGTERM and SIGINT, and at once where that takes too long."""

    def end(number: int, frame: Any) -> None:
        if not ending.is_set():
            ending.set()
            last = threading.Timer(GRACE, os._exit, (1,))
            last.daemon = True
            last.start()

    signal.signal(signal.SIGTERM, end)
    signal.signal(signal.SIGINT, end)


def link_to_json(link: Link) -> dict[str, Any]:
    """A link as JSON."""
    return {**vars(link), "credentials": str(link.credentials) if link.credentials else None}


def link_from_json(given: dict[str, Any]) -> Link:
    """A link from its JSON."""
    folder = Path(given["credentials"]) if given["credentials"] else None
    return Link(
        **{**given, "listen": tuple(given["listen"]), "connect": tuple(given["connect"]), "credentials": folder}
    )


def share_to_json(share: Share) -> dict[str, Any]:
    """A share as JSON."""
    return {**vars(share), "sources": [list(source) for source in share.sources], "link": link_to_json(share.link)}


def share_from_json(given: dict[str, Any]) -> Share:
    """A share from its JSON."""
    sources = tuple((role, name) for role, name in given["sources"])
    return Share(**{**given, "sources": sources, "link": link_from_json(given["link"])})


if __name__ == "__main__":
    sys.exit(main())
