"""What the services of a live robot are asked and what they answer.

A request and its answer are JSON objects with the fields of the structs here. As in a description, fields may be added:
the other end ignores those that it does not know, and takes the default of those that are not sent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from navloom_live.live.service import Nothing, Service

__all__ = [
    "ADD",
    "CANCEL",
    "CLEAR",
    "EXTEND",
    "GET_PARAMETERS",
    "LIMIT",
    "PLACE",
    "PLAN",
    "RELOCALISE",
    "REPLAN",
    "SET_PARAMETERS",
    "SUBMIT",
    "SWAP",
    "Add",
    "Added",
    "Alternative",
    "Assignments",
    "Between",
    "Extend",
    "Extended",
    "GoalNumber",
    "ParameterValues",
    "Place",
    "Placed",
    "Planned",
    "Selected",
    "SpeedLimit",
    "Submit",
    "Swap",
]


@dataclass(frozen=True)
class Submit:
    """A goal: place, m, heading there, rad, None for any, and points to pass, m, all in the map frame."""

    x: float
    y: float
    heading: float | None = None
    via: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class GoalNumber:
    """Number of the goal; 0 if there is none."""

    goal_id: int


@dataclass(frozen=True)
class Place:
    """Where the robot is: m, m, rad, map frame; for a guess with its standard deviations, m and rad."""

    x: float
    y: float
    heading: float
    spread: float | None = None
    heading_spread: float | None = None


@dataclass(frozen=True)
class Placed:
    """The localizer took the pose; `warning` if the robot does not fit there."""

    placed: bool
    warning: str = ""


@dataclass(frozen=True)
class Between:
    """A start and a goal to plan between, each x, y, m, and heading, rad, map frame."""

    start: tuple[float, float, float]
    goal: tuple[float, float, float]


@dataclass(frozen=True)
class Planned:
    """Points of the path, m, map frame; or none, and the kind of the failure and its explanation, see `PlanFailure`."""

    points: tuple[tuple[float, float], ...]
    kind: str = ""
    detail: str = ""


@dataclass(frozen=True)
class SpeedLimit:
    """Largest speed, m/s, or with `is_percentage`, % of the speed without a limit; 0 for none. An answer is in m/s."""

    speed: float
    is_percentage: bool = False


@dataclass(frozen=True)
class Swap:
    """The instance that should become active."""

    role: str
    instance: str


@dataclass(frozen=True)
class Selected:
    """Swaps that wait, as "role instance"; the role's active instance, and the epoch of the selection."""

    pending: tuple[str, ...]
    selected: str
    epoch: int


@dataclass(frozen=True)
class Assignments:
    """Parameters to change, as TOML assignments."""

    values: tuple[str, ...]


@dataclass(frozen=True)
class ParameterValues:
    """All parameters of an instance by name, and how often they were changed."""

    version: int
    values: dict[str, Any]


@dataclass(frozen=True)
class Add:
    """An instance to start in shadow, named after its plugin or plugin@preset; `again`: also if it failed before."""

    role: str
    instance: str
    again: bool = False


@dataclass(frozen=True)
class Added:
    """An instance that was added.

    Attributes:
        is_new: Whether this request added it.
        state, why, last_words: State of its process, how it ended last, and the end of its log; empty if the config
            named the instance.
    """

    is_new: bool
    state: str = ""
    why: str = ""
    last_words: str = ""


@dataclass(frozen=True)
class Alternative:
    """The `[[alternative]]` table of an added instance."""

    role: str
    plugin: str
    name: str
    shadow: bool


@dataclass(frozen=True)
class Extend:
    """An instance that the robot gains, and the process that will run it."""

    alternative: Alternative
    process: str


@dataclass(frozen=True)
class Extended:
    """Hash of the config of the process from now on."""

    config_sha256: str


SUBMIT = Service("submit", Submit, GoalNumber)
CANCEL = Service("cancel", Nothing, GoalNumber)
REPLAN = Service("replan", Nothing, GoalNumber)
PLACE = Service("place", Place, Placed)
RELOCALISE = Service("relocalise", Nothing, Nothing)
PLAN = Service("plan", Between, Planned)
CLEAR = Service("clear", Nothing, Nothing)
LIMIT = Service("limit", SpeedLimit, SpeedLimit)
SWAP = Service("swap", Swap, Selected)
GET_PARAMETERS = Service("params/get", Nothing, ParameterValues)
SET_PARAMETERS = Service("params/set", Assignments, ParameterValues)
ADD = Service("add", Add, Added)
EXTEND = Service("extend", Extend, Extended)
