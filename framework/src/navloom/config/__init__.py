"""One TOML file: its schema, its loading with overrides, and where each value came from."""

from navloom.config.loader import ConfigError, Loaded, check_params, load_config, shipped_configs
from navloom.config.schema import Config

__all__ = ["Config", "ConfigError", "Loaded", "check_params", "load_config", "shipped_configs"]
