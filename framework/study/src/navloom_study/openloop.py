"""Open-loop comparison: the baseline drives, and the methods that differ from it in one role run in shadow."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from navloom.config import ConfigError, Loaded
from navloom.config.config_presets import instance_of
from navloom.config.schema import Config
from navloom.inputs.texts import INSTANCE
from navloom.roles import FIXED

from navloom_study.study_methods import Method

__all__ = ["METHOD", "OpenLoop", "open_loop_of"]

METHOD = "(open loop)"
"""Method name in the keys of open-loop episodes; no method can have this name."""


@dataclass(frozen=True, eq=False)
class OpenLoop:
    """The method that drives and the methods that run in shadow.

    Attributes:
        baseline: Name of the method that drives.
        shadows: Method by name of the instance that represents it.
        left_out: By method, why it cannot run in shadow of the baseline.
        loaded: The config with the shadows.
    """

    baseline: str
    shadows: dict[str, str]
    left_out: dict[str, str]
    loaded: Loaded

    def request(self) -> dict[str, Any]:
        """The entry of `study.json`."""
        return {"baseline": self.baseline, "shadows": self.shadows, "left_out": self.left_out}


def open_loop_of(methods: Sequence[Method], baseline: str) -> OpenLoop:
    """The baseline's config with the other methods in shadow.

    Raises:
        ConfigError: No method differs from the baseline in one role only.
    """
    base = next(method for method in methods if method.name == baseline)
    tree = base.loaded.config.model_dump(mode="json", exclude_unset=True)
    tables, shadows, left_out = list(tree.get("alternative", [])), {}, {}
    taken = {(table["role"], instance_of(table)) for table in tables}
    for number, method in enumerate(methods):
        if method is base:
            continue
        differs = _differing(base.loaded.config, method.loaded.config)
        role = differs[0]
        if len(differs) > 1 or role not in base.loaded.config.roles or role in FIXED:
            left_out[method.name] = (
                f"differs in {', '.join(differs)}: only one role other than platform, or one node, can be shadowed"
            )
            continue
        name = method.name if re.fullmatch(INSTANCE, method.name) else f"method_{number}"
        if (role, name) in taken or name in shadows or name == base.loaded.config.role_table(role).instance:
            name = f"shadow_{number}"
        table = method.loaded.config.role_table(role).model_dump(mode="json", exclude_unset=True)
        # A shadow never keeps the robot from driving.
        table.pop("required", None)
        tables.append({**table, "role": role, "name": name, "shadow": True})
        shadows[name] = method.name
    if not shadows:
        why = "; ".join(f"{name} {reason}" for name, reason in left_out.items()) or "there is one method only"
        raise ConfigError(
            f"--open-loop: nothing can run beside {baseline}: {why}; vary one role, as in avoider=vff,vfh"
        )
    # The methods become alternatives of one ordinary config, so that the trace can be compared with that of a run
    # without them.
    config = Config.model_validate({**tree, "alternative": tables})
    return OpenLoop(baseline, shadows, left_out, replace(base.loaded, config=config))


def _differing(ours: Config, theirs: Config) -> list[str]:
    """Tables in which two methods differ, alternatives excepted; a [[node]] appears under its name."""
    mine, other = ours.model_dump(mode="json"), theirs.model_dump(mode="json")
    for tree in (mine, other):
        tree |= {table["name"]: table for table in tree.pop("node")}
    places = [place for place in {**mine, **other} if place not in ("alternative", "live")]
    return [place for place in places if mine.get(place) != other.get(place)] or ["nothing"]
