"""The plugin door: hook specifications, the registry and discovery by entry point."""

from navloom.plugins.discovery import Discovery, PluginInfo
from navloom.plugins.hooks import HookSpecs, MessageObserver, RunInfo, hookimpl
from navloom.plugins.registry import PluginError, Registry

__all__ = ["Discovery", "HookSpecs", "MessageObserver", "PluginError", "PluginInfo", "Registry", "RunInfo", "hookimpl"]
