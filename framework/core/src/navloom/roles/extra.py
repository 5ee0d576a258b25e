"""Extra inputs: messages that a plugin reads in addition to its role's inputs."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, Generic, Literal, TypeVar, overload

from navloom.errors import NavloomError
from navloom.messages import Message

__all__ = ["NO_EXTRAS", "Extra", "Extras", "MissingExtraError", "extras_of"]

M = TypeVar("M", bound=Message)
V = TypeVar("V")
"""What a plugin reads: a message; or None too, if the input is optional."""


class Extra(Generic[V]):
    """An additional input of a role's plugin, declared as a class attribute: `tracks = Extra(Tracks)`.

    The plugin reads the newest message as `given.extra[self.tracks]`. It comes from the only node or sensor that
    publishes this class, or from the stream that `inputs` in the plugin's table names.

    Args:
        carries: The message class.
        optional: The verb is called before the first message too, and reads None, also if nothing publishes the class;
            otherwise the node waits for it.
        delayed: It is read as published up to the end of the previous tick, which breaks a cycle.
    """

    name = ""

    @overload
    def __init__(
        self: Extra[M], carries: type[M], *, optional: Literal[False] = False, delayed: bool = False
    ) -> None: ...

    @overload
    def __init__(
        self: Extra[M | None], carries: type[M], *, optional: Literal[True], delayed: bool = False
    ) -> None: ...

    def __init__(self, carries: type[Any], *, optional: bool = False, delayed: bool = False) -> None:
        self.carries: type[Message] = carries
        self.optional, self.delayed = optional, delayed

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __repr__(self) -> str:
        return f"Extra {self.name!r} of {self.carries.__name__}"


class MissingExtraError(NavloomError, KeyError):
    """An extra input that a step does not have. Its text is a sentence, which KeyError itself would quote."""

    def __str__(self) -> str:
        return str(self.args[0])


class Extras:
    """The extra inputs of one step, by their declarations.

    Args:
        held: The newest message of each; None for an optional input before its first message.
    """

    __slots__ = ("_held",)

    def __init__(self, held: Mapping[Extra[Any], Message | None] = MappingProxyType({})) -> None:
        self._held = held

    def __getitem__(self, extra: Extra[V]) -> V:
        """The newest message of an input; None for an optional one that nothing publishes.

        Raises:
            MissingExtraError: The plugin does not declare this input.
        """
        try:
            found: V = self._held[extra]  # type: ignore[assignment]  # the wiring gives it what it declares
        except KeyError:
            if extra.optional:
                return None  # type: ignore[return-value]  # an optional input is of V | None
            held = ", ".join(one.name for one in self._held) or "none"
            name, message = extra.name or "name", extra.carries.__name__
            raise MissingExtraError(
                f"{extra!r} is not among the extra inputs of this step ({held}): declare it in the plugin's class, "
                f"{name} = Extra({message}); a unit test gives it with the input, extra=extras({name}=(Plugin.{name}, "
                "message)) of navloom.testing"
            ) from None
        return found


NO_EXTRAS = Extras()
"""Extra inputs of a plugin that declares none."""


@cache
def extras_of(cls: type) -> Mapping[str, Extra[Any]]:
    """The extra inputs that a plugin's class declares or inherits, by name."""
    declared = {name: var for base in reversed(cls.__mro__) for name, var in vars(base).items()}
    return MappingProxyType({name: one for name, one in declared.items() if isinstance(one, Extra)})
