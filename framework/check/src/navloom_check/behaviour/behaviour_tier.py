"""The behaviour tier: a plugin must behave as it claims; the rest is reported without judgement."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import PurePath
from typing import Any

from navloom.navigation.trajectory import warm_up
from navloom.roles import ROLES, Role
from navloom.roles.claims import Claim

from navloom_check.behaviour import parameter_effects
from navloom_check.behaviour.avoider_scenes import AVOIDERS
from navloom_check.behaviour.controller_scenes import CONTROLLERS
from navloom_check.behaviour.mapping_scenes import LOCALIZERS, MAPPERS
from navloom_check.behaviour.measurements import Behaviour, Maker, Measured, Unfit, shrunk
from navloom_check.behaviour.obstacle_scene import Scene
from navloom_check.behaviour.planner_scenes import PLANNERS
from navloom_check.behaviour.platform_scenes import PLATFORMS, RECOVERIES
from navloom_check.behaviour.scene_picture import draw
from navloom_check.check_bench import USUAL, Bench, alike
from navloom_check.checked_plugin import Subject
from navloom_check.checks import Check
from navloom_check.contract.beam_order import mounts
from navloom_check.findings import Finding, NotRun, Remark
from navloom_check.side_effects import GUARD

__all__ = ["BEHAVIOUR", "BEHAVIOURS", "CHECKS"]

BEHAVIOUR = "behaviour"
BEHAVIOURS: tuple[Behaviour, ...] = (
    *PLATFORMS, *LOCALIZERS, *MAPPERS, *PLANNERS, *CONTROLLERS, *AVOIDERS, *RECOVERIES
)  # fmt: skip
"""All behaviours, role by role."""
SCENE_LIMIT = 120.0
"""Longest time that one scene may take, s; a drive has hundreds of steps."""


class _Raised(Exception):
    """A plugin raised in a scene."""

    def __init__(self, error: BaseException, place: str) -> None:
        super().__init__(f"raises {type(error).__name__}: {error}")
        self.place = place


def measured(behaviour: Behaviour, make: Maker, scene: Scene, subject: Subject) -> Measured:
    """Result of one scene. Raises Unfit, or _Raised for an error that comes from the plugin's code."""
    try:
        with alike(), GUARD.within(f"{behaviour.name}", SCENE_LIMIT):
            return behaviour.measure(make, scene)
    except Unfit:
        raise
    except (Exception, SystemExit) as error:
        own = [f for f, _ in traceback.walk_tb(error.__traceback__) if subject.is_own(f.f_globals.get("__name__", ""))]
        if not own:
            raise
        raise _Raised(error, f"{PurePath(own[-1].f_code.co_filename).name}:{own[-1].f_lineno}") from error


def _judge(behaviour: Behaviour, bench: Bench) -> Iterator[Finding | Remark]:
    """Measure a plugin in every scene of one behaviour. `answers` reports a plugin that finishes no scene."""
    if bench.of_topic(USUAL):
        bench.sound()
    cls, claim = bench.subject.thing, behaviour.claim
    make = Maker(cls, bench.subject.params, bench.seed)
    warm_up()
    failed: list[tuple[int, Scene, Measured]] = []
    values = []
    for seed in range(bench.seed, bench.seed + behaviour.scenes):
        scene = behaviour.scene(seed)
        try:
            seen = measured(behaviour, make, scene, bench.subject)
        except Unfit as error:
            if claim not in claims_of(cls):
                raise NotRun(str(error)) from None
            # A claim that was not tested is no pass: it would hide what the plugin does.
            expected = (
                f"inputs that the scenes have, or disclaims = {{Claim.{claim.name}: REASON}} and a test of your own"
            )
            yield Finding(f"cannot be tested: {error}", expected, given="the class")
            return
        except _Raised as error:
            yield Finding(str(error), "an answer in every scene", error.place, scene.words, _name(seed))
            return
        values.append(seen.value)
        if not seen.holds:
            failed.append((seed, scene, seen))
    if claim in claims_of(cls):
        if failed:
            yield _finding(behaviour, bench, make, failed)
        return
    yield _shown(behaviour, bench, failed)


def claims_of(cls: type[Role]) -> frozenset[Claim]:
    """Claims that a plugin must meet: the purpose of its role and its own claims, without those it disclaims."""
    return (purpose_of(cls.role) | frozenset(cls.claims)) - frozenset(cls.disclaims)


def purpose_of(role: str) -> frozenset[Claim]:
    """The purpose of a role, as claims; empty for a node plugin."""
    return ROLES[role].facts.purpose if role in ROLES else frozenset()


def _finding(behaviour: Behaviour, bench: Bench, make: Maker, failed: Sequence[tuple[int, Scene, Measured]]) -> Finding:
    """Finding for the first scene that failed, reduced as long as it still fails."""
    seed, scene, seen = failed[0]
    try:
        with alike(), GUARD.within(behaviour.name, SCENE_LIMIT):
            scene, seen = shrunk(behaviour, make, scene, seen)
    except Exception:  # the plugin may raise in a reduced scene: then the original one is reported
        seed, scene, seen = failed[0]
    source = "its role claims" if behaviour.claim in purpose_of(behaviour.role) else "it claims"
    others = f"; {len(failed)} of {behaviour.scenes} scenes fail" if len(failed) > 1 else ""
    picture = _drawn(f"{bench.subject.full_name}: {behaviour.name}", behaviour, bench, seed, scene, seen)
    expected = f"{behaviour.demand}, since {source} {behaviour.claim.name}"
    return Finding(seen.said + others, expected, "", scene.words, _name(seed), picture)


def _shown(behaviour: Behaviour, bench: Bench, failed: Sequence[tuple[int, Scene, Measured]]) -> Remark:
    """Remark on a behaviour that the plugin does not claim."""
    held = behaviour.scenes - len(failed)
    text = f"expected {behaviour.demand}; held in {held} of {behaviour.scenes} scenes"
    why = dict(bench.subject.thing.disclaims).get(behaviour.claim)
    text = f"{text}; not claimed{f': {why}' if why else ''}"
    picture = ""
    if failed:
        seed, scene, seen = failed[0]
        text = f"{text}; in {_name(seed)} it {seen.said}"
        picture = _drawn(
            f"{bench.subject.full_name}: {behaviour.name}, not claimed", behaviour, bench, seed, scene, seen
        )
    return Remark(text, {"held": float(held), "scenes": float(behaviour.scenes)}, picture)


def _name(seed: int) -> str:
    return f"scene {seed}"


def _drawn(title: str, behaviour: Behaviour, bench: Bench, seed: int, scene: Scene, seen: Measured) -> str:
    """Draw the picture of a scene. Gives its path; empty if no pictures are wanted."""
    if bench.out is None:
        return ""
    path = bench.out / f"{bench.subject.full_name}-{behaviour.name}-{seed}.png"
    draw(path, title, scene, seen)
    return str(path)


def _claims(bench: Bench) -> Iterator[Finding]:
    """Find claims that the role has no scenes for, and disclaimers of what the role does not claim."""
    cls: Any = bench.subject.thing
    known = {b.claim for b in BEHAVIOURS if b.role == bench.subject.kind}
    names = ", ".join(f"Claim.{claim.name}" for claim in Claim if claim in known) or "none"
    for claim in cls.claims:
        if claim not in known:
            yield Finding(f"claims {claim!r}", f"claims of a {bench.subject.kind}: {names}", given="the class")
    purpose = purpose_of(bench.subject.kind)
    for claim, reason in dict(cls.disclaims).items():
        if claim not in purpose:
            told = ", ".join(sorted(f"Claim.{one.name}" for one in purpose)) or "nothing"
            yield Finding(f"disclaims {claim!r}", f"a claim of its role: {told}", given="the class")
        elif not (isinstance(reason, str) and len(reason.split()) > 2):
            yield Finding(f"disclaims {claim.name} with the reason {reason!r}", "a sentence that says why")


def _run_of(claim: Claim) -> Callable[[Bench], Iterator[Finding | Remark]]:
    by_role = {b.role: b for b in BEHAVIOURS if b.claim is claim}
    return lambda bench: _judge(by_role[bench.subject.kind], bench)


def _demand_of(claim: Claim) -> str:
    return "; ".join(f"{b.role}: {b.demand}" for b in BEHAVIOURS if b.claim is claim)


CHECKS = (
    Check("claims", BEHAVIOUR, frozenset(ROLES), "Its role has scenes for each of its claims.", _claims, True),
    *(
        Check(claim.value, BEHAVIOUR, frozenset(b.role for b in BEHAVIOURS if b.claim is claim), _demand_of(claim),
              _run_of(claim))
        for claim in Claim
    ),
    *parameter_effects.CHECKS,
    mounts,
)  # fmt: skip
"""One check for each claim, one for the list of claims, and those that only show something."""
