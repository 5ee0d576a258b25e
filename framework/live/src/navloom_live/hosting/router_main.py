"""Entry point of a router process: `python -m navloom_live.hosting.router_main FILE`."""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Callable
from pathlib import Path

from navloom.crashes import dump_when_broken
from navloom.parent_process import die_with_parent

from navloom_live.hosting.process_setup import end_on_signal, link_from_json
from navloom_live.hosting.router_replacement import Router
from navloom_live.transport.links import Link

__all__ = ["main", "route"]


ROUTER_ALIVE_INTERVAL = 0.5
"""Interval of calls of `alive` and of checks for new certificates, s."""


def route(
    link: Link,
    ending: threading.Event,
    say: Callable[[str], None],
    ready: Callable[[], None] = lambda: None,
    alive: Callable[[], None] = lambda: None,
) -> None:
    """Run a router until `ending` is set; `alive` is called regularly."""
    with Router(link, say) as router:
        ready()
        while not ending.wait(ROUTER_ALIVE_INTERVAL):
            alive()
            router.look(ending)


def main() -> int:
    """Run a router with the link in a file until a signal."""
    dump_when_broken()
    spec = json.loads(Path(sys.argv[1]).read_text("utf-8"))
    die_with_parent(int(spec["parent"]))
    ending = threading.Event()
    end_on_signal(ending)
    try:
        route(link_from_json(spec["link"]), ending, lambda text: print(f"router: {text}", flush=True))
    except Exception as error:
        print(f"router: {error}", file=sys.stderr, flush=True)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
