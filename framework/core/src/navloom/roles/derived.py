"""Parameters that follow from the robot where a config leaves them out: `Role.derived` gives them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from pydantic import BaseModel

T = TypeVar("T")
M = TypeVar("M", bound=BaseModel)

if TYPE_CHECKING:
    from typing import TypeAlias

    # A plugin reads `self.params`, in which every value is filled in.
    Derivable: TypeAlias = T
else:

    class Derivable:
        """Type of a parameter that `Role.derived` gives if it is left out: `Derivable[float] = Field(LEFT_OUT, …)`."""

        def __class_getitem__(cls, item: Any) -> Any:
            return item | None


LEFT_OUT: Any = None
"""Default of a parameter that is `Derivable`."""

__all__ = ["LEFT_OUT", "Derivable", "Derived", "filled", "left_out"]


class Derived(NamedTuple):
    """A value that a plugin derives, and what it follows from, as in "footprint and max_deceleration"."""

    value: Any
    source: str


def left_out(params: BaseModel, derived: Mapping[str, Derived]) -> dict[str, Derived]:
    """The derived values of parameters that are left out, or for which the config has a word, as "inscribed"."""
    return {name: one for name, one in derived.items() if isinstance(getattr(params, name), (str, type(None)))}


def filled(params: M, derived: Mapping[str, Derived]) -> M:
    """The parameters with the derived values of those left out; what counts as given in the config stays the same."""
    values = {name: one.value for name, one in left_out(params, derived).items()}
    if not values:
        return params
    return type(params).model_construct(_fields_set=set(params.model_fields_set), **{**dict(params), **values})
