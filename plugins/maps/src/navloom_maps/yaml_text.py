"""YAML from elsewhere, read with bounds."""

from __future__ import annotations

from typing import Any

import yaml
from navloom.inputs import DEEPEST, Refusal, first_words, shortened

__all__ = ["yaml_of"]


def yaml_of(content: bytes, where: str, refusal: Refusal) -> Any:
    """A YAML document of plain values; for the arguments see `toml_of`."""
    _refuse_hostile(content, where, refusal)
    try:
        return yaml.safe_load(content)
    except (yaml.YAMLError, ValueError, TypeError, LookupError, AttributeError, ArithmeticError) as error:
        # In addition to its own errors, PyYAML raises those of the value types (dates, integers).
        raise refusal(f"{where}: not YAML: {first_words(error)}") from None


def _refuse_hostile(content: bytes, where: str, refusal: Refusal) -> None:
    """Refuse aliases, which can expand a short file without limit, and deep nesting, on which the parser recurses."""
    depth = 0
    try:
        for event in yaml.parse(content, Loader=yaml.SafeLoader):
            if isinstance(event, yaml.AliasEvent):
                name = shortened(event.anchor)
                raise refusal(f"{where}: alias {name}: expected its value; aliases are not read")
            if isinstance(event, yaml.CollectionStartEvent):
                depth += 1
            elif isinstance(event, yaml.CollectionEndEvent):
                depth -= 1
            if depth > DEEPEST:
                raise refusal(f"{where}: more than {DEEPEST} levels deep, expected at most {DEEPEST}")
    except (yaml.YAMLError, UnicodeError, LookupError) as error:
        raise refusal(f"{where}: not YAML: {first_words(error)}") from None
