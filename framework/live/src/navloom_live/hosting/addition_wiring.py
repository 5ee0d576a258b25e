"""Lets the nodes of a running process know of an instance that their robot gains."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from functools import partial

from navloom.engine.system import System

from navloom_live.hosting.system_extension import admit_part, with_alternative
from navloom_live.live.live_node import Source
from navloom_live.live.live_node_builder import Hosted, widen
from navloom_live.live.live_runner import LiveRunner
from navloom_live.live.process_streams import Switchboard
from navloom_live.live.replicated_state_reader import MemoryReader
from navloom_live.live.requests import Extend, Extended

__all__ = ["AddedInstances"]


class AddedInstances:
    """Connects the nodes of this process to the streams of added instances, which run in processes of their own.

    Args:
        system: The robot as this process knows it; it gains the instances.
        hosted, live: The nodes and runners of this process.
        board: Its streams.
        monitor: Reads the parameters of every instance.
    """

    def __init__(
        self,
        system: System,
        hosted: Mapping[Source, Hosted],
        live: Mapping[Source, LiveRunner],
        board: Switchboard,
        monitor: MemoryReader,
    ) -> None:
        self._system, self._hosted, self._live, self._board, self._monitor = system, hosted, live, board, monitor
        self._lock = threading.Lock()

    def extend(self, asked: Extend) -> Extended:
        """Take in an instance, on a service's thread. The nodes read it from their next steps on.

        Raises:
            ConfigError: The table does not fit.
        """
        process, source = asked.process, (asked.alternative.role, asked.alternative.name)
        with self._lock:
            system = self._system
            # A request may be repeated by a supervisor that got no answer: the second time there is nothing to do.
            if source not in system.parts:
                admit_part(system, with_alternative(system.loaded, vars(asked.alternative), process), source)
                self._board.bus.bring_here("/".join(source), f"process/{process}")
                self._monitor.follow(source)
                changes = [
                    (self._live[own], widen(system, one, source, self._board)) for own, one in self._hosted.items()
                ]
                # Before any node reads the new inlets; connected ones stay as they are.
                self._board.connect()
                for runner, more in changes:
                    # On the node's own thread, between two steps: a step must not see its inputs change.
                    runner.change(partial(runner.admit, more))
            return Extended(system.loaded.sha256())
