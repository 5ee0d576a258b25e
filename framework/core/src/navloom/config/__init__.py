"""The config: schema of the TOML file, loading with overrides, and the source of each value."""

from navloom.config.loader import ConfigError, Loaded, check_params, load_config, shipped_configs
from navloom.config.schema import Config

__all__ = ["Config", "ConfigError", "Loaded", "check_params", "load_config", "shipped_configs"]
