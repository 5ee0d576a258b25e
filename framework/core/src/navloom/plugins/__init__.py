"""Where plugins enter: hook specifications, the registry, and discovery by entry point.

Begin with `hooks.py`, all hooks on one page, then `discovery.py`: it lists plugins, and `loading.py` imports them.
`one_file.py` loads plugins from one Python file; `message_opening.py` decodes messages of any distribution.
`error_origin.py`, `code_owners.py` and `thread_owners.py` name the plugin behind an error, a line or a thread.
"""

from navloom.plugins.discovery import Discovery, PluginInfo
from navloom.plugins.hooks import HookSpecs, MessageObserver, RunInfo, hookimpl
from navloom.plugins.registry import PluginError, Registry

__all__ = ["Discovery", "HookSpecs", "MessageObserver", "PluginError", "PluginInfo", "Registry", "RunInfo", "hookimpl"]
