"""What a role's plugins are given and answer: `navloom plugins avoider`, for a terminal without the site."""

from __future__ import annotations

import inspect
from dataclasses import fields
from types import NoneType
from typing import Any

from navloom.cli.describing.docstrings import meanings

__all__ = ["described", "print_role"]


def described(role: str) -> dict[str, Any]:
    """A role's verb with the type of its answer, and the fields of all that its plugins see."""
    from navloom.messages import Message
    from navloom.roles import ROLES, Context, RobotSpec, answers_of, given_of, verb_of

    cls = ROLES[role]
    verb = getattr(cls, verb_of(role))
    answer = str(inspect.signature(verb).return_annotation)
    seen = {"given": given_of(role)}
    for kind in answers_of(role):
        if not issubclass(kind, (Message, NoneType)):
            seen["answer"] = kind
    seen |= {"self.context": Context, "self.context.robot": RobotSpec}
    return {
        "role": role,
        "about": inspect.getdoc(cls),
        "verb": f"{verb.__name__}(self, given: {given_of(role).__name__}) -> {answer}",
        "verb_about": inspect.getdoc(verb),
        "fields": {what: _fields(one) for what, one in seen.items()},
    }


def print_role(told: dict[str, Any], names: list[str]) -> None:
    """The same for people, and which plugins of the role are installed."""
    import typer

    from navloom.cli.output import print_table

    typer.echo(f"{told['role']}: {(told['about'] or '').splitlines()[0]}")
    typer.echo(f"{told['verb']}\n    {told['verb_about']}\n")
    for what, rows in told["fields"].items():
        print_table((what, "type", "meaning"), [(row["name"], row["type"], row["meaning"]) for row in rows])
        typer.echo()
    typer.echo("the fields of a message: `navloom messages RangeScan`")
    typer.echo(f"installed: {', '.join(names) or 'none'}; the parameters of one: `navloom plugins {told['role']}.NAME`")


def _fields(cls: Any) -> list[dict[str, str]]:
    told = meanings(inspect.getdoc(cls) or "")
    return [{"name": field.name, "type": str(field.type), "meaning": told.get(field.name, "")} for field in fields(cls)]
