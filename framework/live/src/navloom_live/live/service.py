"""A service of a live robot: how it is asked and how it answers, and the services that ask and answer nothing.

`navloom stop` needs no more than this, so the structs of all other services are apart, in `requests`.
"""

from __future__ import annotations

import json
import uuid
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from navloom.errors import NavloomError
from navloom.inputs.typed_json import from_builtins

from navloom_live.transport.idempotent_requests import REQUEST, Once
from navloom_live.transport.query_limits import QuestionError, read_question
from navloom_live.transport.zenoh_bus import Question

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

__all__ = ["ENTER_UNSEEN", "GATE", "RELEASE", "RESUME", "STOP", "Answered", "Asked", "Nothing", "Service", "reply",
           "request_bytes"]  # fmt: skip

Asked = TypeVar("Asked", bound="DataclassInstance")
Answered = TypeVar("Answered", bound="DataclassInstance")


@dataclass(frozen=True)
class Service(Generic[Asked, Answered]):
    """A service of a node, of a process, or of the supervisor.

    Attributes:
        name: Its name, the end of its key.
        asked: Class of its requests.
        answered: Class of its answers.
    """

    name: str
    asked: type[Asked]
    answered: type[Answered]


@dataclass(frozen=True)
class Nothing:
    """A request or an answer without fields."""


STOP, RESUME = Service("stop", Nothing, Nothing), Service("resume", Nothing, Nothing)
RELEASE, ENTER_UNSEEN = Service("release", Nothing, Nothing), Service("enter_unseen", Nothing, Nothing)
GATE: Mapping[str, Service[Nothing, Nothing]] = {one.name: one for one in (STOP, RESUME, RELEASE, ENTER_UNSEEN)}
"""Services of the gate that take no argument, by name."""


def request_bytes(asked: DataclassInstance) -> bytes:
    """A request on the wire, with a name of its own: a retry sends the same bytes, and is carried out once."""
    return json.dumps({**asdict(asked), REQUEST: uuid.uuid4().hex}).encode()


def reply(
    key: str, service: Service[Asked, Answered], handler: Callable[[Asked], Answered], once: Once
) -> Callable[[Question], None]:
    """A callback that reads a request, has it carried out once, and answers or refuses it.

    Args:
        key: Key of the service.
        service: The service.
        handler: Carries out a request. A NavloomError or QuestionError refuses it with its text.
        once: Keeps the answers for retries.
    """

    def carry_out(given: dict[str, Any]) -> dict[str, Any]:
        try:
            asked = from_builtins(service.asked, given)
        except ValueError as error:
            raise QuestionError(f"request not understood: {service.name}: {error}") from None
        return asdict(handler(asked))

    guarded = once.guard(carry_out)

    def handle(question: Question) -> None:
        try:
            answer = guarded(read_question(question.data))
        except (QuestionError, NavloomError) as error:
            question.refuse(str(error))
        else:
            question.answer(key, json.dumps(answer).encode(), "json")

    return handle
