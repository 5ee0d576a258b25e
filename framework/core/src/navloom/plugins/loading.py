"""Loads entry points into one pluggy manager. An entry point that fails does not affect the others."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import EntryPoint
from pathlib import PurePath
from typing import Any

import pluggy

from navloom.entry_kinds import GROUP, TRACE_HOOKS, CommandPoint
from navloom.plugins.error_origin import raised_in
from navloom.plugins.hooks import HookSpecs
from navloom.plugins.registry import PluginError, Registry
from navloom.roles import ROLES

__all__ = ["Loader", "module_of", "owner_of"]


class _Hooked:
    """The hook implementations of one entry point. Several entry points may share a module."""

    def __init__(self, point: EntryPoint, hooks: Mapping[str, Any]) -> None:
        self.__dict__.update(hooks)
        self.__dict__["_point"] = point


class Loader:
    """The plugin manager of a discovery: it registers an entry point when its name is first needed.

    Args:
        blocked: Names of entry points that are never loaded.
    """

    def __init__(self, blocked: Iterable[str]) -> None:
        self._manager = pluggy.PluginManager(GROUP)
        self._manager.add_hookspecs(HookSpecs)
        for name in blocked:
            self._manager.set_blocked(name)
        if os.environ.get(TRACE_HOOKS):
            self._manager.add_hookcall_monitoring(_tell_call, _tell_outcome)

    def is_blocked(self, name: str) -> bool:
        """Whether an entry point of this name counts as not installed."""
        return bool(self._manager.is_blocked(name))

    def register(self, name: str, point: EntryPoint) -> Registry:
        """Import an entry point's module and let it register into a new registry that it shares with no other.

        Raises:
            PluginError: It fails. It is then unregistered, and loaded again when its name is needed next.
        """
        if point.name.partition(".")[0] in ROLES:  # it may bring kernels
            from navloom.kernel_cache import harden_kernel_cache

            harden_kernel_cache()
        registry = Registry()
        try:
            self._manager.register(_Hooked(point, self._implemented(point.load())), name)
            # A misspelt hook would never be called, and nobody would notice.
            self._manager.check_pending()
            self.call(name, "navloom_register", registry=registry)
        except BaseException as error:
            self._manager.unregister(name=name)
            if isinstance(error, PluginError):
                raise PluginError(f"plugin {point.name!r} from {point.value}: {error}") from error
            # Ctrl-C is no fault of the plugin.
            if not isinstance(error, (Exception, SystemExit)):
                raise
            cause = " ".join(raised_in(error, module_of(point)).split())
            if isinstance(error, pluggy.PluginValidationError):
                cause += "; the hooks are those of navloom.HookSpecs, as `navloom_register(registry)`"
            raise PluginError(
                f"plugin {point.name!r} from {point.value} fails on import: {cause}; "
                f"repair it, or block it if it is not needed"
            ) from error
        return registry

    def call(self, name: str, hook: str, **given: Any) -> Sequence[Any]:
        """Call a hook of one registered entry point; its exceptions propagate."""
        others = [held for other, held in self._manager.list_name_plugin() if held is not None and other != name]
        # One entry point at a time: pluggy stops at the first exception, which would cost the others their call.
        answers: Sequence[Any] = self._manager.subset_hook_caller(hook, others)(**given)
        return answers

    def _implemented(self, target: Any) -> dict[str, Any]:
        """Hook implementations of a module, or of any other object that an entry point names."""
        names = [name for name in dir(target) if self._manager.parse_hookimpl_opts(target, name) is not None]
        return {name: getattr(target, name) for name in names}


def owner_of(point: EntryPoint) -> str:
    """Name of the distribution of an entry point, or its module if the distribution is not known."""
    return str(point.dist.name) if point.dist else point.value


def module_of(point: EntryPoint | CommandPoint) -> str:
    """Name of the module that an entry point names, with or without an attribute after it."""
    return point.value.partition(":")[0].strip()


def _tell_call(hook: str, called: Sequence[Any], given: Mapping[str, Any]) -> None:
    for one in called:
        code, point = one.function.__code__, one.plugin._point
        place = f"{PurePath(code.co_filename).name}:{code.co_firstlineno}"
        print(f"navloom: hook {hook}: {point.name} of {owner_of(point)} ({place})", file=sys.stderr)


def _tell_outcome(outcome: pluggy.Result[Any], hook: str, called: Sequence[Any], given: Mapping[str, Any]) -> None:
    if outcome.exception is not None:
        error = outcome.exception
        print(f"navloom: hook {hook}: raised {type(error).__name__}: {error}", file=sys.stderr)
