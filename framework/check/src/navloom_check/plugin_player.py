"""Plays a plugin of a role: makes an object, gives it inputs in turn, and compares its answers byte by byte."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from hashlib import sha256
from pathlib import PurePath
from typing import Any

import numpy as np
from navloom.engine.answer_checks import (
    AnswerError,
    LocalizerDoor,
    MapperDoor,
    PlannerDoor,
    PlatformDoor,
    TwistDoor,
    TypeDoor,
)
from navloom.engine.node_ports import Out
from navloom.engine.random_streams import stream_source
from navloom.errors import NavloomError
from navloom.messages import Message
from navloom.messages.codec import decode, encode, schema_label
from navloom.roles import Context, InputError, PlatformOutput, answers_of
from navloom.roles.extra import Extras

from navloom_check.checked_plugin import Subject
from navloom_check.side_effects import GUARD

__all__ = ["Fault", "NOWHERE", "Player", "bytes_of", "digest", "first_difference", "loosened", "rebuilt",
           "size_of", "through_codec"]  # fmt: skip

NOWHERE = ("", 0, 0, 0, 0, 0)
"""An empty envelope."""
TOLERANCE = 0.2
"""Goal tolerance with which paths are checked, m."""


class Fault(NavloomError):
    """A call that raised, or that gave a wrong answer.

    Attributes:
        problem: What the plugin did, as a sentence without its subject.
        expected: What it should have done.
        place: File and line of its code.
        is_refusal: It raised InputError, which means that it cannot use its input.
        call: The method that was called.
    """

    def __init__(self, problem: str, expected: str, place: str, is_refusal: bool = False, call: str = "") -> None:
        super().__init__(problem)
        self.problem, self.expected, self.place = problem, expected, place
        self.is_refusal, self.call = is_refusal, call


class RewindableStreams:
    """The random streams of a context, which can be restarted."""

    def __init__(self, source: Callable[[str], np.random.Generator]) -> None:
        self._source = source
        self._made: dict[str, tuple[np.random.Generator, Any]] = {}

    def __call__(self, name: str) -> np.random.Generator:
        if name not in self._made:
            stream = self._source(name)
            self._made[name] = (stream, stream.bit_generator.state)
        return self._made[name][0]

    def rewind(self) -> None:
        """Restart each stream, so that it repeats its numbers."""
        for stream, state in self._made.values():
            stream.bit_generator.state = state


class Player:
    """One object of a plugin, with a separate context.

    Args:
        subject: The plugin.
        context: Its context, in which new random streams from the seed replace the old ones.
        seed: Seed of its streams.
        params: Its parameters; by default those of the subject.

    Raises:
        Fault: The constructor failed.
    """

    def __init__(self, subject: Subject, context: Context, seed: int, params: Any = None) -> None:
        self.subject = subject
        self.streams = RewindableStreams(stream_source(seed, subject.kind, context.instance))
        self.context = replace(context, stream=self.streams)
        self.params = subject.params if params is None else params
        self.plugin = self._call("__init__", lambda: subject.thing(self.params, self.context))
        self._door = self._new_door()

    def step(self, given: Any) -> Any:
        """Call the verb once, and check the answer as the framework does. Raises Fault."""
        answer = self._call(self.subject.verb, lambda: self._step(given))
        try:
            return self._door(answer, given)
        except AnswerError as error:
            problem, _, expected = str(error).rpartition(" (")[0].partition(", expected ")
            raise Fault(problem.partition("() ")[2] or problem, expected, self.subject.place) from None
        except (AttributeError, TypeError, ValueError) as error:
            problem = f"gives {type(answer).__name__} with fields that cannot be read: {error}"
            raise Fault(problem, "the types that the fields declare", self.subject.place) from None

    def _step(self, given: Any) -> Any:
        return getattr(self.plugin, self.subject.verb)(given)

    def play(self, inputs: Iterable[Any]) -> list[bytes]:
        """Hashes of the answers to inputs. Raises Fault."""
        return [digest(self.step(given)) for given in inputs]

    def reset(self) -> None:
        """Reset the plugin, and restart its streams. Raises Fault."""
        self.streams.rewind()
        self._call("reset", self.plugin.reset)
        self._door = self._new_door()

    def configure(self, params: Any) -> None:
        """Give it new parameters. Raises Fault."""
        self._call("configure", lambda: self.plugin.configure(params))

    def _new_door(self) -> Callable[[Any, Any], Any]:
        """The check of an answer against its input; from a new door, since doors remember stamps."""
        plugin, kind = self.plugin, self.subject.kind
        if kind == "platform":
            door_of_robot = PlatformDoor(plugin, self.context.sensors)
            # The answer itself: the door takes readings of range_max for no echo, and the checks are to see them.
            return lambda answer, given: (door_of_robot.check(answer, given), answer)[1]
        if kind == "localizer":
            return LocalizerDoor(plugin).check
        if kind == "mapper":
            return MapperDoor(plugin).check
        if kind == "planner":
            return PlannerDoor(plugin, TOLERANCE, self.context.robot).check
        (gives, *_) = answers_of(kind)
        door: TwistDoor[Any] | TypeDoor = TwistDoor(plugin, gives) if plugin.facts.commands else TypeDoor(plugin)
        return lambda answer, given: door.check(answer)

    def _call(self, what: str, act: Callable[[], Any]) -> Any:
        try:
            with GUARD.within(what):
                return act()
        except (Exception, SystemExit, KeyboardInterrupt) as error:
            problem = f"{what}() raises {type(error).__name__}: {error}"
            raise Fault(problem, "an answer", self._line_of(error), isinstance(error, InputError), what) from error

    def _line_of(self, error: BaseException) -> str:
        """The innermost line of the plugin's own code in the traceback of an error."""
        place = ""
        for frame, line in traceback.walk_tb(error.__traceback__):
            if self.subject.is_own(str(frame.f_globals.get("__name__", ""))):
                place = f"{PurePath(frame.f_code.co_filename).name}:{line}"
        return place or self.subject.place


def bytes_of(value: Any) -> bytes:
    """An answer or an input as bytes: equal for equal contents, bit for bit."""
    if isinstance(value, Message):
        return schema_label(type(value)).encode() + encode(value, NOWHERE)
    if isinstance(value, np.ndarray):
        return value.tobytes()
    if isinstance(value, Extras):
        return b"".join(bytes_of(one) for one in value._held.values())
    if isinstance(value, Mapping):
        return b"".join(str(key).encode() + bytes_of(one) for key, one in value.items())
    if isinstance(value, Out):
        return value.name.encode()
    if isinstance(value, (tuple, list)):
        return b"".join(map(bytes_of, value)) + b"%d" % len(value)
    if is_dataclass(value) and not isinstance(value, type):
        return b"".join(bytes_of(getattr(value, field.name)) for field in fields(value))
    return repr(value).encode()


def digest(value: Any) -> bytes:
    """A hash of an answer or an input: equal for equal contents, bit for bit."""
    return sha256(bytes_of(value)).digest()


def rebuilt(value: Any, leaf: Callable[[Message], Message], array: Callable[[Any], Any]) -> Any:
    """An input with its messages and arrays replaced."""
    if isinstance(value, Message):
        return leaf(value)
    if isinstance(value, np.ndarray):
        return array(value)
    if isinstance(value, Extras):
        return Extras({key: rebuilt(one, leaf, array) for key, one in value._held.items()})
    if isinstance(value, Mapping):
        return {key: rebuilt(one, leaf, array) for key, one in value.items()} if value else value
    if isinstance(value, tuple) and not hasattr(value, "_fields"):
        return tuple(rebuilt(one, leaf, array) for one in value)
    if is_dataclass(value) and not isinstance(value, type):
        return type(value)(**{field.name: rebuilt(getattr(value, field.name), leaf, array) for field in fields(value)})
    return value


def through_codec(given: Any) -> Any:
    """An input whose messages were encoded and decoded, as for a plugin in another process."""
    return rebuilt(given, lambda one: decode(encode(one, NOWHERE), schema_label(type(one)))[0], lambda array: array)


def loosened(given: Any) -> Any:
    """An input with writable arrays, which show whether a plugin writes to them."""
    return rebuilt(given, _loose_message, np.array)


def _loose_message(message: Message) -> Message:
    made = object.__new__(type(message))
    for name in message.kinds:
        value = getattr(message, name)
        type(message).__dict__[name].__set__(made, rebuilt(value, _loose_message, np.array))
    return made


def size_of(answer: Any) -> int:
    """Bytes of all messages of an answer."""
    if isinstance(answer, PlatformOutput):
        return sum(len(bytes_of(one)) for one in (answer.odometry, *answer.scans.values()))
    return sum(map(size_of, answer)) if isinstance(answer, (list, tuple)) else len(bytes_of(answer))


def first_difference(one: Sequence[bytes], other: Sequence[bytes]) -> int | None:
    """Number of the first step at which two plays differ; None where they are equal."""
    for number, (here, there) in enumerate(zip(one, other, strict=False)):
        if here != there:
            return number
    return None if len(one) == len(other) else min(len(one), len(other))
