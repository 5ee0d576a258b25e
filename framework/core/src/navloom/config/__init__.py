"""The config: tables of the TOML file, loading with overrides, and the source of each value.

Begin with `tables.py`, every table with its defaults and units, then `schema.py` and `loader.py`, `load_config`.
`config_errors.py` words every problem: place, value, expectation and the nearest fix, all of a file at once.
Defaults stand only here; other houses read them from the models. `shipped/` holds the configs of the distribution.
"""

from navloom.config.loader import ConfigError, Loaded, check_params, load_config, shipped_configs
from navloom.config.schema import Config

__all__ = ["Config", "ConfigError", "Loaded", "check_params", "load_config", "shipped_configs"]
