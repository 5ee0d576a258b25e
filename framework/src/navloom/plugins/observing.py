"""The observers that are installed, in one run: told of its start and its end, and shown its messages."""

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
    """Every entry point `observer.NAME`, for one run. Use it in a `with` statement: it tells the end, whatever it is.

    An observer that fails is reported once, and takes no further part: the run is the same with and without it.

    Args:
        discovery: Where they are found.
        say: Told what fails.
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
        """The run begins: load the observers, tell them, and give those that want to be shown messages."""
        looking = []
        for name in dict.fromkeys(self._discovery.names(KIND)):
            try:
                self._discovery.load(KIND, name)
            except PluginError as error:
                self._say(f"{error}; the run goes on without it")
                continue
            self._running[name] = replace(run, config=deepcopy(run.config))
            self._call(name, "navloom_run_started")
            for given in self._call(name, "navloom_observe"):
                if name in self._running:
                    looking.append(Onlooker(given, lambda error, name=name: self._drop(name, "on_message", error)))  # type: ignore[misc]
        return looking

    def finish(self, summary: Mapping[str, Any] | None) -> None:
        """The run has ended; said once."""
        for name in list(self._running):
            self._call(name, "navloom_run_finished", summary=deepcopy(summary))
        self._running.clear()

    def _call(self, name: str, hook: str, **given: Any) -> list[Any]:
        if name not in self._running:
            return []
        try:
            with redirect_stdout(sys.stderr):  # standard output is the result's
                return list(self._discovery.call(KIND, name, hook, run=self._running[name], **given))
        except (Exception, SystemExit) as error:
            self._drop(name, hook, error)
            return []

    def _drop(self, name: str, hook: str, error: BaseException) -> None:
        self._running.pop(name, None)
        blamed = self._discovery.blamed(KIND, name, error)
        self._say(f"{blamed} in {hook}; the run goes on without it")


class Onlooker:
    """What an observer gave to be shown messages, as a run calls it: it raises nothing.

    Args:
        given: The observer's object.
        drop: Told what it raised, once.

    Attributes:
        wants: Pairs of role and port, or None for all.
        wants_steps: Never.
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
        """Show it a message."""
        if self._show is None:
            return
        try:
            self._show(role, instance, active, port, message, at)
        except (Exception, SystemExit) as error:
            self._show = None
            self._drop(error)

    def on_step(self, record: StepRecord) -> None:
        """Step records are not shown."""
