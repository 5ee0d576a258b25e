"""Shell completion of values: which names a shell proposes for an option or an argument.

typer completes commands and options itself, and its scripts propose files where no name fits.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from copy import copy
from typing import Annotated, Any

from typer.models import ParameterInfo

from navloom.installed import candidates

__all__ = ["proposing_names"]

KINDS = {
    "CONFIG": "configs",
    "REALM/NAME": "robots",
    "ROLE.NAME": "plugins",
    "ROLE|ROLE.NAME": "plugins",
    "ROLE": "roles",
    "ROLE[.NAME]": "roles",
    "MAP": "worlds",
    "REF": "worlds",
}
"""Kind of `navloom.installed.candidates` by metavar."""


def proposing_names(parameter: inspect.Parameter) -> inspect.Parameter:
    """The parameter of a command, with names to propose if it is called as a role or its metavar is one of `KINDS`.

    Args:
        parameter: Its annotation is `Annotated[type, typer.Option(...)]` or one with `typer.Argument`; any other
            parameter is returned as it is.
    """
    from navloom.roles import ROLES

    metadata: tuple[Any, ...] = getattr(parameter.annotation, "__metadata__", ())
    if len(metadata) != 1 or not isinstance(metadata[0], ParameterInfo) or metadata[0].autocompletion:
        return parameter
    info = copy(metadata[0])  # several parameters may share one annotation
    kind = parameter.name if parameter.name in ROLES else KINDS.get((info.metavar or "").strip("[]…"), "")
    info.autocompletion = _names(kind) if kind else None
    return parameter.replace(annotation=Annotated[parameter.annotation.__origin__, info])


def _names(kind: str) -> Callable[[str], list[str]]:
    def names(incomplete: str) -> list[str]:
        return [name for name in candidates(kind) if name.startswith(incomplete)]

    return names
