"""The distributions that provide a config's plugins."""

from __future__ import annotations

from navloom.config.schema import Config
from navloom.config.tables import ROLE_TABLES
from navloom.plugins import Discovery
from navloom.plugins.registry import NODE

__all__ = ["distributions"]


def distributions(config: Config) -> dict[str, str]:
    """Version of each distribution that provides a plugin in use, by name; missing plugins are left out."""
    used = {(role if role in ROLE_TABLES else NODE, table.plugin) for _, role, table in config.role_tables()}
    infos = Discovery(config.plugins.blocked).infos()
    return {
        info.distribution: info.version
        for info in sorted(infos, key=lambda info: info.distribution)
        if (info.role, info.name) in used and info.distribution
    }
