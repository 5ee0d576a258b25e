"""Why the gate stops the robot: the kinds of stops, and one table of what each means.

A new kind needs a name in `StopKind`, a row in `STOPS`, and the place in the gate that stops for it. The table stands
beside the message, so that tools read it without the gate and its kernels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from navloom.messages.schema import Message, Most, Words, message

__all__ = ["STOPS", "Stop", "StopKind", "StopReason"]

StopKind = Literal[
    "operator", "contact", "obstacle", "no_room", "ending", "no_trajectory", "waits", "silent_platform",
    "silent_sensor", "silent", "goal_late", "goal_halted", "stale_operator", "stale", "rivals", "gone",
    "old_selection", "other",
]  # fmt: skip

_DOCTOR = "`navloom doctor` looks for the cause"
_AGAIN = "run this again in a moment"
_GONE = f"{_AGAIN}: it has just gone, and `navloom up` restarts it"
_SILENT = "`navloom hz` shows its stream, `navloom doctor` looks for the cause"
_SLOW = "its process or the network is too slow: `navloom doctor` says which"
_NONE_IS_SLOW = (
    "no node is slow now: `navloom hz '*/command'` shows how old commands are; end other programs on its host, or make "
    "gate.stop_deadline longer"
)


@dataclass(frozen=True)
class Stop:
    """What a kind of stop means. Texts may hold `{who}`, `{of}` and, in `words`, `{limit}`: what the monitor sees.

    Attributes:
        text: The reason as one text; if it ends with a space, who follows.
        words: The reason for people, to follow "stopped:".
        remedy: What to do; may hold `{stream}`, the first stream of `of`, as role/port.
        advice: What to do if `navloom doctor` finds no other fault; empty for the remedy.
        joint: What stands in the text between who and of.
        is_at_rest: It interrupts no drive: there is nothing to drive yet, or no longer.
        is_ramp: An ordinary stop: the robot brakes by its limits. Any other stop is a step to zero.
        hides: It takes precedence over an earlier stop for a silent operator, which then still holds.
        restores: What a restarted gate latches, so that the stop lasts until `resume`; empty for nothing.
    """

    text: str
    words: str
    remedy: str
    advice: str = ""
    joint: str = ""
    is_at_rest: bool = False
    is_ramp: bool = False
    hides: bool = False
    restores: Literal["", "operator", "contact"] = ""


STOPS: dict[StopKind, Stop] = {
    "operator": Stop(
        "operator", "by an operator", "`navloom resume` lets it drive again", is_ramp=True, restores="operator"
    ),
    "contact": Stop("contact", "it touched something", "`navloom resume` when the way is clear", restores="contact"),
    "obstacle": Stop(
        "obstacle", "{limit}", "the goal recovers after 2 s; `navloom teleop` drives away from it"
    ),  # or space that no sensor has seen: the limit tells
    "no_room": Stop(  # something is beside a robot that is to turn on the spot
        "no room to turn",
        "no room to turn, {limit}",
        "the recovery drives out and turns where there is room, after 2 s",
    ),
    "ending": Stop("ending", "its gate has ended", "`navloom up` restarts it", is_at_rest=True),
    # Nothing to drive: a goal that was reached, cancelled or ended in any other way, a drive that pauses or waits for a
    # new plan, and an operator who releases the robot.
    "no_trajectory": Stop(
        "no_trajectory",
        "no path to follow",
        "`navloom goal X Y` gives it a goal",
        f"{_AGAIN}; if it persists, `navloom cancel` it and send the goal again",
        is_at_rest=True,
        is_ramp=True,
    ),
    "waits": Stop(  # a node of the chain, for the first message of an input
        "waits: ",
        "{who} waits for {of}",
        "`navloom hz {stream}` shows whether it arrives, `navloom list` shows which nodes are missing",
        joint=" for ",
        is_at_rest=True,
        is_ramp=True,
    ),
    "silent_platform": Stop(
        "silent: platform",
        "the platform is silent",
        _DOCTOR,
        "`navloom hz platform/odometry` shows whether it arrives; see the log of its process",
        hides=True,
    ),
    "silent_sensor": Stop(
        "silent: sensor ",
        "sensor {who} is silent",
        _SILENT,
        "`navloom hz platform/{who}` shows whether it arrives; see its cable and the platform's log",
        hides=True,
    ),
    "silent": Stop(  # a role whose command is missing
        "silent: ",
        "{who} is silent",
        _SILENT,
        "`navloom hz {who}/command` shows whether it arrives; see the log of its process",
    ),
    "goal_late": Stop(
        "stale: goal main",
        "its goal node does not step",
        _DOCTOR,
        "its process had no processor time, or C code of a mapper or planner held the GIL: end other programs on its "
        "host, or make gate.stop_deadline longer",
    ),
    "goal_halted": Stop(  # it has not stepped since the platform restarted
        "gone: goal main does not step",
        "its goal node does not step",
        _DOCTOR,
        _GONE,
    ),
    "stale_operator": Stop(  # while a driving operator is silent, no other source drives until `resume`
        "stale: operator ",
        "the operator gives commands from old data",
        _SLOW,
        _NONE_IS_SLOW,
        restores="operator",
    ),
    "stale": Stop(
        "stale: ",
        "{who} gives commands from old data",
        _SLOW,
        _NONE_IS_SLOW,
    ),
    "rivals": Stop(  # two processes publish one of the streams that the gate decides on
        "rivals: ",
        "{who} {of} publish the same stream",
        "`navloom doctor` names both: end one of them",
        joint=" ",
    ),
    "gone": Stop(
        "gone: ",
        "{who} is gone",
        "`navloom doctor` says which process it belongs to",
        _GONE,
    ),
    "old_selection": Stop(
        "old_selection: ",
        "{who} does not know of the last swap",
        "it passes with its next step, else ask `navloom doctor`",
        f"{_AGAIN}; if it persists, restart the process of {{who}}",
    ),
    "other": Stop("", "{who}", "`navloom echo gate/status` shows whether it passes"),  # of another version
}


@message()
class StopReason(Message):
    """Why the gate stops the robot.

    The table `STOPS` of `navloom.messages.stop_reasons` says of each kind what people read, what to do, whether the
    robot brakes by a ramp, and what else follows. `navloom messages StopReason` lists the kinds.

    Attributes:
        kind: What happened.
        who: Node, role or sensor that is the cause; empty if the kind says it.
        of: What it waits for, or where it runs; empty for nothing.
    """

    kind: Annotated[StopKind, Most(32)]
    who: Words = ""
    of: Words = ""

    @property
    def stop(self) -> Stop:
        """What the kind means."""
        return STOPS[self.kind]

    @property
    def text(self) -> str:
        """The reason as one text, as `stale: controller main`."""
        return f"{self.stop.text}{self.who}{self.stop.joint if self.of else ''}{self.of}"

    @property
    def head(self) -> str:
        """The first word of the text, by which stops are counted: `stale`."""
        return self.text.partition(":")[0]

    def in_words(self, limit: str = "") -> tuple[str, str]:
        """The reason for people, to follow "stopped:", and what to do; `limit` is what the monitor sees."""
        stream = self.of.split(" and ")[0].replace(".", "/")
        words = self.stop.words.format(who=self.who, of=self.of, limit=limit).rstrip()
        return words, self.stop.remedy.format(stream=stream)

    @property
    def advice(self) -> str:
        """What to do if no other fault is found; empty if the remedy says it."""
        return self.stop.advice.format(who=self.who)

    @classmethod
    def parse(cls, text: str) -> StopReason | None:
        """The reason of a `text`; None if it is empty, of kind `other` if no kind has such a text."""
        heads = {stop.text: kind for kind, stop in STOPS.items() if kind != "other"}
        if not text or text in heads:
            return cls(heads[text]) if text else None
        for head in sorted((head for head in heads if head.endswith(" ")), key=len, reverse=True):
            if text.startswith(head):
                kind, rest = heads[head], text.removeprefix(head)
                return cls(kind, *_parted(rest, STOPS[kind].joint))
        return cls("other", text)


def _parted(rest: str, joint: str) -> tuple[str, str]:
    """Who and of. Who is a role and an instance where a space alone parts them."""
    if joint == " ":
        role, _, rest = rest.partition(" ")
        instance, _, of = rest.partition(" ")
        return f"{role} {instance}", of
    who, _, of = rest.partition(joint) if joint else (rest, "", "")
    return who, of
