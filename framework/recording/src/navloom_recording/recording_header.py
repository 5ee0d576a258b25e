"""The header of a recording: its robot, how the nodes were driven, the config and the versions."""

from __future__ import annotations

import importlib.metadata
import json
import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Literal

from navloom.config import Loaded
from navloom.errors import NavloomError
from navloom.inputs.texts import json_of

__all__ = ["HEADER", "Kind", "RecordingError", "RecordingHeader", "header_of"]

HEADER = "navloom"
"""Name of the metadata record that holds the header, as JSON under `header`."""

Kind = Literal["lockstep", "barrier", "live", "imported"]


class RecordingError(NavloomError, ValueError):
    """A file is not a navloom recording, or lacks what was requested; the text says which and what to do."""


@dataclass(frozen=True)
class RecordingHeader:
    """Header of a recording.

    Attributes:
        realm, robot: Names of the robot, with which all keys begin.
        kind: Executor of the nodes; "imported" is a log of another system: messages of a platform, no steps.
        period: Control period, s.
        seed: Seed of every random stream.
        clock: Clock of the receive times: "wall" is ns since 1970, "run" is the run clock.
        config: The config in the form passed to other processes (`Loaded.to_json`); None if it was not known.
        effective: The config with all defaults.
        config_sha256: Hash of the config; empty if there is none.
        versions: Versions of Python, navloom, numpy and the distributions of the plugins in use.
        origin: Name of the log that was imported; empty otherwise.
    """

    realm: str
    robot: str
    kind: Kind
    period: float
    seed: int
    clock: Literal["run", "wall"]
    config: dict[str, Any] | None = None
    effective: dict[str, Any] = field(default_factory=dict)
    config_sha256: str = ""
    versions: dict[str, str] = field(default_factory=dict)
    origin: str = ""

    @property
    def prefix(self) -> str:
        """REALM/ROBOT, with which all keys begin."""
        return f"{self.realm}/{self.robot}"

    def loaded(self) -> Loaded:
        """The recorded config. Raises RecordingError if there is none or this version does not accept it."""
        if self.config is None:
            raise RecordingError("the recording holds no config: its robot did not say which one it runs")
        try:
            return Loaded.from_json(self.config)
        except (ValueError, KeyError, TypeError) as error:
            raise RecordingError(f"the config in the recording does not fit this version of navloom: {error}") from None

    def to_text(self) -> str:
        """The header as JSON."""
        return json.dumps(asdict(self), ensure_ascii=False, sort_keys=True)

    @classmethod
    def from_text(cls, text: str) -> RecordingHeader:
        """Read a header from JSON, ignoring fields of later versions. Raises RecordingError for anything else."""
        try:
            given = json_of(text, "JSON", ValueError)
            known = {one.name for one in fields(cls)}
            return cls(**{name: value for name, value in given.items() if name in known})
        except (ValueError, TypeError, AttributeError) as error:
            raise RecordingError(f"the head of the recording cannot be read: {error}") from None


def header_of(loaded: Loaded, kind: Kind, distributions: Mapping[str, str]) -> RecordingHeader:
    """The header of a recording of a robot with a config.

    Args:
        loaded: The config.
        kind: Executor of the nodes.
        distributions: Version of each distribution whose plugins it uses, by name.
    """
    config = loaded.config
    return RecordingHeader(
        config.robot.realm,
        config.robot.name,
        kind,
        config.run.period,
        config.run.seed,
        # Barrier runs are simulated too, but a recorder receives them over the network.
        "run" if kind == "lockstep" else "wall",
        loaded.to_json(),
        config.model_dump(mode="json"),
        loaded.sha256(),
        versions(distributions),
    )


def versions(distributions: Mapping[str, str]) -> dict[str, str]:
    """Versions that the outputs may depend on."""
    found = {name: importlib.metadata.version(name) for name in ("navloom", "numpy", "numba")}
    return {"python": platform.python_version(), **found, **distributions}
