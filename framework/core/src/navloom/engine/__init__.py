"""The graph of nodes and its executor in lockstep. It has no thread, socket, file or clock of its own.

Begin with `build.py`, `assemble`: from a config to a `System`; then `stepper.py`, when a node steps
and what comes of it, and `lockstep.py`.
`streams.py` declares every stream once; `node_graph.py` orders the nodes; `wiring.py` carries messages by reference.
`plugin_factory.py` makes the plugins, `lockstep_builder.py` the executor; `answer_checks.py` checks what they return.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from navloom.parts import lazy_names

if TYPE_CHECKING:
    from navloom.engine.random_streams import stream_source as stream_source
    from navloom.engine.system import System as System
else:
    __all__, __getattr__ = lazy_names(
        "navloom.engine",
        {
            "navloom.engine.random_streams": "stream_source",
            "navloom.engine.system": "System",
        },
    )
