"""The two nodes of a dora dataflow, for `wire`: `python dora_ends.py PART SOCKET SIZES`, PART is `ping` or `echo`.

Each sends an Arrow array made from a numpy array, and views the received array with numpy, without a copy, as in dora's
examples. It imports dora-rs, pyarrow, numpy and `trips`, and may run under another interpreter.
"""

from __future__ import annotations

import json
import sys
import time

import numpy as np
import pyarrow as pa  # type: ignore[import-not-found]
from dora import Node  # type: ignore[import-not-found]
from trips import PATIENCE, Lost, as_the_runtime_does, serve_trips


def main(part: str, socket: str, sizes: str) -> None:
    """Run one node until its dataflow ends."""
    as_the_runtime_does()
    by_name: dict[str, int] = json.loads(sizes)
    random = np.random.default_rng(7)  # zeros would all be read from one page of memory
    arrays = {size: random.integers(0, 256, size, np.uint8) for size in by_name.values()}
    node = Node()
    if part == "echo":
        for event in node:
            if event["type"] == "INPUT":
                node.send_output("data", pa.array(arrays[event["value"].to_numpy().size]))
            elif event["type"] == "STOP":
                break
        return

    def trip(name: str) -> int:
        array = arrays[by_name[name]]
        began = time.perf_counter_ns()
        node.send_output("data", pa.array(array))
        event = node.next(timeout=PATIENCE)
        while event is not None and event["type"] != "INPUT":
            event = node.next(timeout=PATIENCE)
        got = None if event is None else event["value"].to_numpy()
        spent = time.perf_counter_ns() - began
        if got is None or got.size != array.size:
            raise Lost
        return spent

    serve_trips(socket, "dora ping", trip)


if __name__ == "__main__":
    main(*sys.argv[1:])
