"""Entry point of a node process: `python -m navloom_live.hosting.node_main FILE`; the file says what to run."""

from __future__ import annotations

import contextlib
import json
import os
import sys
from pathlib import Path
from typing import Any

from navloom.config.loader import Loaded
from navloom.crashes import dump_when_broken
from navloom.engine.build import assemble
from navloom.kernel_cache import tell_compiled
from navloom.parent_process import die_with_parent

from navloom_live.hosting.heartbeat import Heart
from navloom_live.hosting.node_process import NodeProcess, Share, leave, longest_seizure
from navloom_live.hosting.process_setup import (
    end_on_signal,
    end_unless_called,
    link_from_json,
    link_to_json,
    tolerate_write_errors,
)
from navloom_live.live.node_placement import goes_first

__all__ = ["main", "share_from_json", "share_to_json"]

CONTROL_PRIORITY = -10
"""Nice value of processes that drive and neither map nor plan."""


def main() -> int:
    """Run the share in a file until a signal. Exit codes: 0 signal, 1 failure, 2 wrong request, 70 a node hung.

    The watch in this process cannot see a node that holds the GIL: if the node computes, a system timer ends the
    process, and if it sleeps, the supervisor does.
    """
    # First of all: a full disk must not end a node through its output.
    tolerate_write_errors()
    dump_when_broken()
    spec = json.loads(Path(sys.argv[1]).read_text("utf-8"))
    die_with_parent(int(spec["parent"]))
    sys.setswitchinterval(0.0005)  # a control node must not wait 5 ms for another thread that computes
    roles = {role for role, _ in spec["share"]["sources"]}
    # Mapper and planner share cores with the control nodes, which must not wait for a plan.
    if goes_first(roles):
        go_first()
    system, share = assemble(Loaded.from_json(spec["loaded"])), share_from_json(spec["share"])
    process = NodeProcess(system, share, known=spec["known"].encode())
    end_on_signal(process.ending)
    name = process.share.name
    rearm = end_unless_called(longest_seizure(process.share.sources, system.config.live.hang_timeout))
    heart = Heart(spec["heart"]) if spec["heart"] else None
    if heart is not None:
        tell_compiled(heart.note_compiled)
    is_ready = False

    def ready() -> None:
        nonlocal is_ready
        is_ready = True
        print(f"{name}: ready", flush=True)

    def alive() -> None:
        # Each call postpones the system's timer.
        rearm()
        if is_ready and heart is not None:  # before that its main thread waits for the network
            heart.beat()

    try:
        process.run(lambda text: print(f"{name}: {text}", flush=True), ready, alive)
    except Exception as error:
        print(f"{name}: {type(error).__name__}: {error}", file=sys.stderr, flush=True)
        # Wrong configs and missing devices fail in the same way each time: the supervisor tells them from crashes.
        return 2 if isinstance(error, (ValueError, OSError)) else 1
    if process.hung:
        print(f"{name}: {process.hung}", file=sys.stderr, flush=True)
    return leave(process)


def go_first() -> None:
    """Raise the priority over processes that only compute, if this user may."""
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, CONTROL_PRIORITY)


def share_to_json(share: Share) -> dict[str, Any]:
    """A share as JSON."""
    return {**vars(share), "sources": [list(source) for source in share.sources], "link": link_to_json(share.link)}


def share_from_json(given: dict[str, Any]) -> Share:
    """A share from its JSON."""
    sources = tuple((role, name) for role, name in given["sources"])
    return Share(**{**given, "sources": sources, "link": link_from_json(given["link"])})


if __name__ == "__main__":
    sys.exit(main())
