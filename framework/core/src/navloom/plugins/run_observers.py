"""The installed observers in one run: they are notified of its start and end, and receive its messages."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from contextlib import redirect_stdout
from copy import deepcopy
from dataclasses import replace
from types import TracebackType
from typing import Any

from navloom.messages import Envelope, Message, StepRecord
from navloom.plugins.discovery import Discovery
from navloom.plugins.hooks import MessageObserver, RunInfo
from navloom.plugins.registry import PluginError

__all__ = ["Onlooker", "Onlookers"]

KIND = "observer"


class Onlookers:
    """Every entry point `observer.NAME`, for one run. Use it in a `with` statement, so that the end is always reported.

    An observer that fails is reported once and then ignored: the run is the same with and without it.

    Args:
        discovery: Finds the observers.
        say: Receives a message for each failure.
    """

    def __init__(self, discovery: Discovery, say: Callable[[str], None]) -> None:
        self._discovery, self._say = discovery, say
        self._running: dict[str, RunInfo] = {}

    def __enter__(self) -> Onlookers:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.finish(None)

    def begin(self, run: RunInfo) -> list[Onlooker]:
        """Load the observers, notify them of the run's start, and return those that want messages."""
        looking = []
        for name in dict.fromkeys(self._discovery.names(KIND)):
            try:
                self._discovery.load(KIND, name)
            except PluginError as error:
                self._say(f"{error}; the run goes on without it")
                continue
            # Copies, so that one observer cannot change what another one sees.
            self._running[name] = replace(run, config=deepcopy(run.config))
            self._call(name, "navloom_run_started")
            for given in self._call(name, "navloom_observe"):
                # It may have been dropped by this very call.
                if name in self._running:
                    looking.append(Onlooker(given, lambda error, name=name: self._drop(name, "on_message", error)))  # type: ignore[misc]
        return looking

    def finish(self, summary: Mapping[str, Any] | None, episode: Any = None, out: Any = None) -> None:
        """Notify the observers of the run's end, with the hook's arguments; further calls do nothing."""
        # A copy of the names: one that fails is dropped meanwhile.
        for name in list(self._running):
            self._call(name, "navloom_run_finished", summary=deepcopy(summary), episode=episode, out=out)
        self._running.clear()

    def _call(self, name: str, hook: str, **given: Any) -> list[Any]:
        if name not in self._running:
            return []
        try:
            with redirect_stdout(sys.stderr):  # standard output is for the result
                return list(self._discovery.call(KIND, name, hook, run=self._running[name], **given))
        except (Exception, SystemExit) as error:
            self._drop(name, hook, error)
            return []

    def _drop(self, name: str, hook: str, error: BaseException) -> None:
        self._running.pop(name, None)
        blamed = self._discovery.blamed(KIND, name, error)
        self._say(f"{blamed} in {hook}; the run goes on without it")


class Onlooker:
    """Wraps the object that an observer returned for messages, so that a call raises nothing.

    Args:
        given: The observer's object.
        drop: Receives the first exception of the observer.

    Attributes:
        wants: Pairs of role and port, or None for all.
        wants_steps: Always false.
    """

    wants_steps = False

    def __init__(self, given: MessageObserver, drop: Callable[[BaseException], None]) -> None:
        self._drop = drop
        self._show: Callable[..., None] | None = None
        self.wants: frozenset[tuple[str, str]] | None = frozenset()
        try:
            self.wants = None if given.wants is None else frozenset((role, port) for role, port in given.wants)
            self._show = given.on_message
        except (Exception, SystemExit) as error:
            drop(error)

    def on_message(self, role: str, instance: str, active: bool, port: str, message: Message, at: Envelope) -> None:
        """Pass a message to the observer."""
        if self._show is None:
            return
        try:
            self._show(role, instance, active, port, message, at)
        except (Exception, SystemExit) as error:
            self._show = None
            self._drop(error)

    def on_step(self, record: StepRecord) -> None:
        """Ignore step records: observers do not receive them."""
