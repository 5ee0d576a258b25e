"""The graph of nodes: ports, order, nodes and events. It has no thread, socket, file or clock of its own."""

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
