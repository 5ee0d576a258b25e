"""Adds an instance to a checked config, as a running robot does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from navloom.config.config_errors import problems_of
from navloom.config.loader import Loaded
from navloom.config.schema import Config
from pydantic import ValidationError

__all__ = ["with_alternative"]


def with_alternative(loaded: Loaded, table: Mapping[str, Any], process: str) -> Loaded:
    """The config with one more `[[alternative]]`, which runs in a process of its own.

    Args:
        loaded: The config.
        table: The alternative's table: role, plugin and more.
        process: Name of the new process.

    Raises:
        ConfigError: The table does not fit; one line a problem.
    """
    tree = loaded.config.model_dump(mode="json", exclude_unset=True)
    tree["alternative"] = [*tree.get("alternative", []), dict(table)]
    instance = table.get("name") or table["plugin"]
    processes = {**loaded.config.live.processes, process: [f"{table['role']}.{instance}"]}
    tree["live"] = {**tree.get("live", {}), "processes": processes}
    try:
        config = Config.model_validate(tree)
    except ValidationError as error:
        raise loaded.error(*problems_of(error, Config, given=tree)) from None
    return replace(loaded, config=config)
