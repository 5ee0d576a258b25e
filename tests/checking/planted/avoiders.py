"""Avoiders with a fault each."""

from __future__ import annotations

import math
import random
import time
from dataclasses import replace
from typing import ClassVar

import numpy as np
from navloom import Avoidance, AvoiderDiagnostics, AvoiderInput, Claim, Context, Params, Twist2D
from pydantic import Field

from planted import Entries
from planted.sound import STILL, Gap, GapParams

ENTRIES = Entries()


def turned(answer: Avoidance, more: float) -> Avoidance:
    return replace(answer, twist=Twist2D(answer.twist.vx, 0.0, answer.twist.wz + more))


@ENTRIES.plant("degrees", caught_by="limits")
class Degrees(Gap):
    """Turn rate in degrees a second."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        answer = super().avoid(given)
        return replace(answer, twist=Twist2D(answer.twist.vx, 0.0, math.degrees(answer.twist.wz)))


@ENTRIES.plant("millimetres", caught_by="limits")
class Millimetres(Gap):
    """Speed in mm/s."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        twist = super().avoid(given).twist
        return Avoidance(Twist2D(1000.0 * twist.vx, 0.0, twist.wz), "clear")


@ENTRIES.plant("writes_ranges", caught_by="inputs_untouched")
class WritesRanges(Gap):
    """Replaces ranges of its input in place."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        for scan in given.scans:
            scan.ranges.flags.writeable = True
            scan.ranges[scan.ranges > 1.0] = scan.range_max
        return super().avoid(given)


@ENTRIES.plant("writes_fields", caught_by="inputs_untouched")
class WritesFields(Gap):
    """Changes a frozen message of its input."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        object.__setattr__(given, "target", replace(given.target, x=given.target.x + 1.0))
        return super().avoid(given)


class OutsideParams(GapParams):
    margin: float = Field(0.0, ge=0.05, le=1.0, description="Kept to everything, m.")


@ENTRIES.plant("outside_bounds", caught_by="defaults_within_bounds")
class OutsideBounds(Gap):
    Params = OutsideParams


class UnitlessParams(GapParams):
    margin: float = Field(0.1, ge=0.0, le=1.0)


@ENTRIES.plant("unitless", caught_by="units")
class Unitless(Gap):
    Params = UnitlessParams


class LooseParams(GapParams):
    model_config: ClassVar = {"extra": "ignore"}


@ENTRIES.plant("loose", caught_by="unknown_parameters")
class Loose(Gap):
    """Accepts unknown keys, so that a typing error in a config passes."""

    Params = LooseParams


class TakenParams(Params):
    rate_hz: float = Field(10.0, gt=0.0, le=100.0, description="Answers a second, Hz.")


@ENTRIES.plant("taken_name", caught_by="registers")
class TakenName(Gap):
    Params = TakenParams  # type: ignore[assignment]


@ENTRIES.plant("verb_of_two", caught_by="signatures")
class VerbOfTwo(Gap):
    def avoid(self, given: AvoiderInput, scans: object) -> Avoidance:  # type: ignore[override]
        return super().avoid(given)


@ENTRIES.plant("reset_with_seed", caught_by="signatures")
class ResetWithSeed(Gap):
    def reset(self, seed: int) -> None:  # type: ignore[override]
        self.seed = seed


@ENTRIES.plant("configure_of_none", caught_by="signatures")
class ConfigureOfNone(Gap):
    def configure(self) -> None:  # type: ignore[override]
        self.reset()


@ENTRIES.plant("async_verb", caught_by="signatures")
class AsyncVerb(Gap):
    async def avoid(self, given: AvoiderInput) -> Avoidance:  # type: ignore[override]
        return super().avoid(given)


@ENTRIES.plant("generator_verb", caught_by="answers")
class GeneratorVerb(Gap):
    def avoid(self, given: AvoiderInput):  # type: ignore[no-untyped-def,override]
        yield super().avoid(given)


@ENTRIES.plant("warm_up_of_self", caught_by="registers")
class WarmUpOfSelf(Gap):
    def warm_up(self) -> None:  # type: ignore[override]
        self.avoid(None)  # type: ignore[arg-type]


@ENTRIES.plant("global_numpy", caught_by="global_random")
class GlobalNumpy(Gap):
    def avoid(self, given: AvoiderInput) -> Avoidance:
        return turned(super().avoid(given), 0.01 * float(np.random.rand()))  # noqa: NPY002


@ENTRIES.plant("global_python", caught_by="global_random")
class GlobalPython(Gap):
    def avoid(self, given: AvoiderInput) -> Avoidance:
        return turned(super().avoid(given), 0.01 * random.random())


@ENTRIES.plant("seeds_global", caught_by="global_state")
class SeedsGlobal(Gap):
    """Seeds the global generator, so that it looks reproducible and breaks others."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        np.random.seed(3)  # noqa: NPY002
        return turned(super().avoid(given), 0.01 * float(np.random.rand()))  # noqa: NPY002


@ENTRIES.plant("unseeded", caught_by="repeats")
class Unseeded(Gap):
    """Its own generator, seeded by the system."""

    def __init__(self, params: GapParams, context: Context) -> None:
        super().__init__(params, context)
        self.noise = np.random.default_rng()

    def avoid(self, given: AvoiderInput) -> Avoidance:
        return turned(super().avoid(given), 0.01 * float(self.noise.random()))


@ENTRIES.plant("wall_clock_time", caught_by="wall_clock")
class WallClock(Gap):
    """Brakes by the wall time since its last step."""

    def __init__(self, params: GapParams, context: Context) -> None:
        super().__init__(params, context)
        self.before = time.monotonic()

    def avoid(self, given: AvoiderInput) -> Avoidance:
        now = time.monotonic()
        dt, self.before = now - self.before, now
        return turned(super().avoid(given), 0.1 * min(dt, 0.1))


@ENTRIES.plant("sleeps", caught_by="step_time")
class Sleeps(Gap):
    def avoid(self, given: AvoiderInput) -> Avoidance:
        time.sleep(0.08)
        return super().avoid(given)


SEEN_BEFORE: list[float] = []


@ENTRIES.plant("module_state", caught_by="episodes")
class ModuleState(Gap):
    """Keeps what it learnt in one episode for the next."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        SEEN_BEFORE.append(given.estimate.pose.x)
        return turned(super().avoid(given), 1e-4 * len(SEEN_BEFORE))


@ENTRIES.plant("class_state", caught_by="episodes")
class ClassState(Gap):
    """A mutable class attribute that all instances share."""

    memory: ClassVar[dict[str, float]] = {"turns": 0.0}

    def avoid(self, given: AvoiderInput) -> Avoidance:
        self.memory["turns"] += 1.0
        return turned(super().avoid(given), 1e-4 * self.memory["turns"])


@ENTRIES.plant("default_argument", caught_by="episodes")
class DefaultArgument(Gap):
    """A default argument that grows."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        return turned(super().avoid(given), 1e-4 * self.count())

    def count(self, seen: list[int] = []) -> int:  # noqa: B006
        seen.append(1)
        return len(seen)


@ENTRIES.plant("nested_none", caught_by="answers")
class NestedNone(Gap):
    def avoid(self, given: AvoiderInput) -> Avoidance:
        return Avoidance(None, "clear")  # type: ignore[arg-type]


@ENTRIES.plant("smuggled_none", caught_by="answers")
class SmuggledNone(Gap):
    """Sets None past the checks of the message."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        answer = super().avoid(given)
        object.__setattr__(answer, "twist", None)
        return answer


@ENTRIES.plant("wrong_answer", caught_by="answers")
class WrongAnswer(Gap):
    def avoid(self, given: AvoiderInput) -> Avoidance:
        return super().avoid(given).twist  # type: ignore[return-value]


@ENTRIES.plant("nan_when_empty", caught_by="odd_readings")
class NanWhenEmpty(Gap):
    """Divides by the number of beams with an echo."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        heard = [scan.ranges[np.isfinite(scan.ranges)] for scan in given.scans]
        with np.errstate(all="ignore"):
            mean = sum(float(h.sum()) for h in heard) / np.float64(sum(len(h) for h in heard))
        answer = super().avoid(given)
        return replace(
            answer, twist=Twist2D(min(answer.twist.vx, float(mean)) + 0.0 * float(mean), 0.0, answer.twist.wz)
        )


@ENTRIES.plant("three_beams", caught_by="odd_readings")
class ThreeBeams(Gap):
    """Smooths over three beams and fails where there are fewer."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        for scan in given.scans:
            if scan.ranges[1] < 0.1 or scan.ranges[2] < 0.1:
                return Avoidance(STILL, "trapped")
        return super().avoid(given)


@ENTRIES.plant("trapped_by_inf", caught_by="reaches")
class TrappedByInf(Gap):
    """Takes a beam without an echo for a wall at the robot."""

    def near(self, given: AvoiderInput) -> tuple[float, float]:
        nearest, ahead = super().near(given)
        return (0.0 if math.isinf(nearest) else nearest), ahead


@ENTRIES.plant("keeps_over_reset", caught_by="reset_as_new")
class KeepsOverReset(Gap):
    """Smooths its turn rate, and reset does not clear that."""

    def __init__(self, params: GapParams, context: Context) -> None:
        super().__init__(params, context)
        self.turn = 0.0

    def avoid(self, given: AvoiderInput) -> Avoidance:
        answer = super().avoid(given)
        self.turn = 0.9 * self.turn + 0.1 * answer.twist.wz
        return replace(answer, twist=Twist2D(answer.twist.vx, 0.0, self.turn))


@ENTRIES.plant("resets_half", caught_by="reset_as_new")
class ResetsHalf(KeepsOverReset):
    """Clears one of two things that it learnt."""

    def __init__(self, params: GapParams, context: Context) -> None:
        super().__init__(params, context)
        self.steps = 0

    def reset(self) -> None:
        self.turn = 0.0

    def avoid(self, given: AvoiderInput) -> Avoidance:
        self.steps += 1
        return turned(super().avoid(given), 1e-3 if self.steps > 60 else 1e-5 * self.steps)


@ENTRIES.plant("starts_thread", caught_by="no_threads")
class StartsThread(Gap):
    def __init__(self, params: GapParams, context: Context) -> None:
        super().__init__(params, context)
        import threading

        self.stop = threading.Event()
        threading.Thread(target=self.stop.wait, daemon=True).start()


@ENTRIES.plant("opens_socket", caught_by="no_files")
class OpensSocket(Gap):
    def avoid(self, given: AvoiderInput) -> Avoidance:
        import socket

        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sending:
            sending.connect(("127.0.0.1", 9))
        return super().avoid(given)


@ENTRIES.plant("writes_file", caught_by="no_files")
class WritesFile(Gap):
    def avoid(self, given: AvoiderInput) -> Avoidance:
        import os

        with open(os.devnull, "a") as log:
            log.write(f"{given.stamp_ns}\n")
        return super().avoid(given)


@ENTRIES.plant("prints", caught_by="silent")
class Prints(Gap):
    def avoid(self, given: AvoiderInput) -> Avoidance:
        print("ranges", *(scan.ranges.tolist() for scan in given.scans))
        return super().avoid(given)


@ENTRIES.plant("leaks", caught_by="memory")
class Leaks(Gap):
    """Keeps every scan for ever, and more."""

    kept: ClassVar[list[np.ndarray]] = []

    def avoid(self, given: AvoiderInput) -> Avoidance:
        self.kept.append(np.ones(60_000))
        return super().avoid(given)


@ENTRIES.plant("huge_diagnostics", caught_by="message_size")
class HugeDiagnostics(Gap):
    def avoid(self, given: AvoiderInput) -> Avoidance:
        window = np.zeros((6000, 6000), np.uint8)
        why = AvoiderDiagnostics(window, 0.01, 0.0, 0.0, np.zeros(0), 0.0, np.zeros((0, 2)), None, "all of it")
        return replace(super().avoid(given), diagnostics=why)


@ENTRIES.plant("exits", caught_by="answers")
class Exits(Gap):
    def avoid(self, given: AvoiderInput) -> Avoidance:
        import sys

        if not given.scans:
            sys.exit("no scan")
        sys.exit(3)


@ENTRIES.plant("exits_hard", caught_by="survives")
class ExitsHard(Gap):
    def avoid(self, given: AvoiderInput) -> Avoidance:
        import os

        os._exit(0)


@ENTRIES.plant("forks", caught_by="no_processes")
class Forks(Gap):
    def avoid(self, given: AvoiderInput) -> Avoidance:
        import os

        child = os.fork()
        if child == 0:
            os._exit(0)
        os.waitpid(child, 0)
        return super().avoid(given)


@ENTRIES.plant("crashes", caught_by="survives")
class Crashes(Gap):
    def avoid(self, given: AvoiderInput) -> Avoidance:
        import ctypes

        ctypes.string_at(0)
        return super().avoid(given)


@ENTRIES.plant("hangs_in_c", caught_by="returns")
class HangsInC(Gap):
    """Holds the GIL in one call of C code."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        sum(range(10**13))
        return super().avoid(given)


@ENTRIES.plant("loops", caught_by="returns")
class Loops(Gap):
    def avoid(self, given: AvoiderInput) -> Avoidance:
        while given.stamp_ns >= 0:
            pass
        return super().avoid(given)


@ENTRIES.plant("order_of_sets", caught_by="fresh_process")
class OrderOfSets(Gap):
    """Takes the first of a set of strings, whose order differs from process to process."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        first = next(iter({"left", "right", "ahead", "back", "slow", "fast", "stay", "turn"}))
        return turned(super().avoid(given), 1e-3 * len(first) + 1e-4 * ord(first[0]))


@ENTRIES.plant("object_ids", caught_by="fresh_process")
class ObjectIds(Gap):
    """Breaks ties by the addresses of objects."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        return turned(super().avoid(given), 1e-5 * (hash(self.name) % 1000))


@ENTRIES.plant("two_in_turn", caught_by="two_instances")
class TwoInTurn(Gap):
    """Instances share a counter in the class; alone, each is right."""

    turn_of: ClassVar[list[object]] = []

    def __init__(self, params: GapParams, context: Context) -> None:
        super().__init__(params, context)
        type(self).turn_of = [self]

    def avoid(self, given: AvoiderInput) -> Avoidance:
        return turned(super().avoid(given), 0.0 if self.turn_of[-1] is self else 0.05)


@ENTRIES.plant("extreme_gain", caught_by="extremes")
class ExtremeGain(Gap):
    """Fails at one end of the bounds of its own parameter."""

    class Params(GapParams):
        smoothing: float = Field(0.5, ge=0.0, le=1.0, description="Share of the old turn rate, no unit.")

    def avoid(self, given: AvoiderInput) -> Avoidance:
        return turned(super().avoid(given), 0.0 / (1.0 - self.params.smoothing))


@ENTRIES.plant("half_sector", caught_by="mirror")
class HalfSector(Gap):
    """Off by one in the sectors: steers one sector too far to the left."""

    claims = {Claim.MIRROR}

    def bearing(self, given: AvoiderInput) -> float:
        sector = math.tau / 36
        return (math.floor(super().bearing(given) / sector) + 1.5) * sector


@ENTRIES.plant("map_frame", caught_by="reaches")
class MapFrame(Gap):
    """Takes a bearing in the map frame for one relative to the heading."""

    def bearing(self, given: AvoiderInput) -> float:
        pose = given.estimate.pose
        return math.atan2(given.target.y - pose.y, given.target.x - pose.x)


@ENTRIES.plant("swapped_axes", caught_by="reaches")
class SwappedAxes(Gap):
    """atan2(x, y)."""

    def bearing(self, given: AvoiderInput) -> float:
        pose = given.estimate.pose
        way = math.atan2(given.target.x - pose.x, given.target.y - pose.y)
        return math.remainder(way - pose.heading, math.tau)


@ENTRIES.plant("unwrapped", caught_by="reaches")
class Unwrapped(Gap):
    """Does not wrap the bearing: beyond 180 degrees it turns the long way round."""

    def bearing(self, given: AvoiderInput) -> float:
        pose = given.estimate.pose
        return math.atan2(given.target.y - pose.y, given.target.x - pose.x) - pose.heading - math.tau


@ENTRIES.plant("wrong_sign", caught_by="reaches")
class WrongSign(Gap):
    def bearing(self, given: AvoiderInput) -> float:
        return -super().bearing(given)


@ENTRIES.plant("ignores_footprint", caught_by="footprint")
class IgnoresFootprint(Gap):
    """Has the numbers of the one robot that it was tried on."""

    claims = {Claim.FOOTPRINT}


@ENTRIES.plant("blind", caught_by="no_contact")
class Blind(Gap):
    """Passes on the desired velocity, whatever is in the way."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        return Avoidance(given.desired, "clear")


@ENTRIES.plant("behind", caught_by="no_contact")
class Behind(Gap):
    """Takes what is behind for what is ahead: it expects bearings of 0 to 360 degrees, and gets -180 to 180."""

    def near(self, given: AvoiderInput) -> tuple[float, float]:
        turned_scans = tuple(replace(scan, ranges=np.roll(scan.ranges, len(scan.ranges) // 2)) for scan in given.scans)
        _, ahead = super().near(replace(given, scans=turned_scans))
        return math.inf, ahead


@ENTRIES.plant("never_stops", caught_by="stops_when_closed")
class NeverStops(Gap):
    """Keeps creeping where it is closed in."""

    claims = {Claim.STOPS_WHEN_CLOSED}

    def avoid(self, given: AvoiderInput) -> Avoidance:
        answer = super().avoid(given)
        return replace(answer, twist=Twist2D(max(0.03, answer.twist.vx), 0.0, answer.twist.wz))


@ENTRIES.plant("north_up", caught_by="rotation")
class NorthUp(Gap):
    """Slower towards the north of the map."""

    claims = {Claim.ROTATION}

    def avoid(self, given: AvoiderInput) -> Avoidance:
        answer = super().avoid(given)
        share = 1.0 - 0.5 * max(0.0, math.sin(given.estimate.pose.heading))
        return replace(answer, twist=Twist2D(answer.twist.vx * share, 0.0, answer.twist.wz))


@ENTRIES.plant("at_origin", caught_by="translation")
class AtOrigin(Gap):
    """Right near the map's origin only."""

    claims = {Claim.TRANSLATION}

    def avoid(self, given: AvoiderInput) -> Avoidance:
        pose = given.estimate.pose
        return turned(super().avoid(given), 0.05 * min(1.0, math.hypot(pose.x, pose.y)))


@ENTRIES.plant("claims_other", caught_by="claims")
class ClaimsOther(Gap):
    """Claims a behaviour that is not one of avoiders."""

    claims = {Claim.OPTIMAL_ANY_ANGLE}
