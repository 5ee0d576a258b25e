"""What a recording says of itself: whose it is, how it was driven, and with which config and versions."""

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
"""Name of the metadata record that holds it, as JSON under `header`."""

Kind = Literal["lockstep", "barrier", "live", "imported"]


class RecordingError(NavloomError, ValueError):
    """A file that is not a recording of ours, or lacks what was asked for; the text says which and what to do."""


@dataclass(frozen=True)
class RecordingHeader:
    """Head of a recording.

    Attributes:
        realm, robot: Whose keys are in it.
        kind: What drove the nodes; "imported" is a log of another system: messages of a platform, and no steps.
        period: Control tick, s.
        seed: Of every random stream.
        clock: What receive times are: "wall" is ns since 1970, "run" is the run clock.
        config: The config as another process of the run is given it (`Loaded.to_json`); None where it was not known.
        effective: The config with every default written out.
        config_sha256: Of the config; empty where there is none.
        versions: Of Python, navloom, numpy and the distributions of the plugins in use.
        origin: What an imported log was made from; empty otherwise.
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
        """What all keys begin with."""
        return f"{self.realm}/{self.robot}"

    def loaded(self) -> Loaded:
        """The config it was recorded with. Raises RecordingError where there is none or it does not fit any more."""
        if self.config is None:
            raise RecordingError("the recording holds no config: its robot did not say which one it runs")
        try:
            return Loaded.from_json(self.config)
        except (ValueError, KeyError, TypeError) as error:
            raise RecordingError(f"the config in the recording does not fit this version of navloom: {error}") from None

    def to_text(self) -> str:
        """As JSON."""
        return json.dumps(asdict(self), ensure_ascii=False, sort_keys=True)

    @classmethod
    def from_text(cls, text: str) -> RecordingHeader:
        """From its JSON; what a later version added is passed over. Raises RecordingError for anything else."""
        try:
            given = json_of(text, "JSON", ValueError)
            known = {one.name for one in fields(cls)}
            return cls(**{name: value for name, value in given.items() if name in known})
        except (ValueError, TypeError, AttributeError) as error:
            raise RecordingError(f"the head of the recording cannot be read: {error}") from None


def header_of(loaded: Loaded, kind: Kind, distributions: Mapping[str, str]) -> RecordingHeader:
    """The head of a recording of a robot with a config.

    Args:
        loaded: The config.
        kind: What drives it.
        distributions: Version of each distribution whose plugins it uses, by name.
    """
    config = loaded.config
    return RecordingHeader(
        config.robot.realm,
        config.robot.name,
        kind,
        config.run.period,
        config.run.seed,
        "run" if kind == "lockstep" else "wall",
        loaded.to_json(),
        config.model_dump(mode="json"),
        loaded.sha256(),
        versions(distributions),
    )


def versions(distributions: Mapping[str, str]) -> dict[str, str]:
    """Versions that outputs may depend on."""
    found = {name: importlib.metadata.version(name) for name in ("navloom", "numpy", "numba")}
    return {"python": platform.python_version(), **found, **distributions}
