"""Plugins that change, read or keep resources that their process shares."""

from __future__ import annotations

import _thread
import locale
import logging
import os
import signal
import sys
import time
import warnings
from contextlib import suppress
from typing import ClassVar

import numpy as np
from navloom import Avoidance, AvoiderInput, Context, ControllerInput, TrackingCommand

from planted import Entries
from planted.sound import Gap, GapParams, Proportional

ENTRIES = Entries()


@ENTRIES.plant("silences_numpy", caught_by="global_state")
class SilencesNumpy(Gap):
    """Changes the error state of numpy when created; a second object finds it changed already."""

    def __init__(self, params: GapParams, context: Context) -> None:
        super().__init__(params, context)
        np.seterr(all="ignore")


@ENTRIES.plant("silences_warnings", caught_by="global_state")
class SilencesWarnings(Gap):
    def __init__(self, params: GapParams, context: Context) -> None:
        super().__init__(params, context)
        warnings.filterwarnings("ignore")


@ENTRIES.plant("logs_all", caught_by="global_state")
class LogsAll(Gap):
    """Sets up the logging of the whole process."""

    def __init__(self, params: GapParams, context: Context) -> None:
        super().__init__(params, context)
        logging.getLogger().setLevel(logging.CRITICAL)


@ENTRIES.plant("sets_locale", caught_by="global_state")
class SetsLocale(Gap):
    def __init__(self, params: GapParams, context: Context) -> None:
        super().__init__(params, context)
        locale.setlocale(locale.LC_ALL, "C" if locale.setlocale(locale.LC_ALL) != "C" else "C.UTF-8")


@ENTRIES.plant("extends_path", caught_by="global_state")
class ExtendsPath(Gap):
    def __init__(self, params: GapParams, context: Context) -> None:
        super().__init__(params, context)
        sys.path.insert(0, os.path.dirname(__file__))


@ENTRIES.plant("takes_alarm", caught_by="global_state")
class TakesAlarm(Gap):
    """Handles a signal."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        if signal.getsignal(signal.SIGALRM) is signal.SIG_DFL:
            signal.signal(signal.SIGALRM, signal.SIG_IGN)
        return super().avoid(given)


@ENTRIES.plant("reads_environment", caught_by="environment")
class ReadsEnvironment(Gap):
    def bearing(self, given: AvoiderInput) -> float:
        return float(os.environ.get("GAP_GAIN", "1.0")) * super().bearing(given)


@ENTRIES.plant("reads_folder", caught_by="environment")
class ReadsFolder(Proportional):
    """Takes a gain from a file of the folder in which navloom was started."""

    def control(self, given: ControllerInput) -> TrackingCommand:
        with suppress(FileNotFoundError), open("tuning.txt", encoding="utf-8") as file:
            raise ValueError(f"unread: {file.read()}")
        return super().control(given)


@ENTRIES.plant("raw_thread", caught_by="no_threads")
class RawThread(Gap):
    """Starts a thread that the module threading does not know."""

    def __init__(self, params: GapParams, context: Context) -> None:
        super().__init__(params, context)
        _thread.start_new_thread(time.sleep, (0.05,))


@ENTRIES.plant("keeps_file", caught_by="no_files")
class KeepsFile(Gap):
    """Reads a file, and does not close it."""

    def __init__(self, params: GapParams, context: Context) -> None:
        super().__init__(params, context)
        self.table = open(os.devnull)  # noqa: SIM115


@ENTRIES.plant("prints_errors", caught_by="silent")
class PrintsErrors(Gap):
    """Prints a line on standard error in each step."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        print(f"{given.target}", file=sys.stderr)
        return super().avoid(given)


@ENTRIES.plant("slow_first", caught_by="step_time")
class SlowFirst(Gap):
    """Does in its first step what belongs in its warm-up."""

    table: ClassVar[list[int]] = []

    def avoid(self, given: AvoiderInput) -> Avoidance:
        if not self.table:
            begun = time.thread_time()
            while time.thread_time() - begun < 0.8:
                pass
            self.table.append(1)
        return super().avoid(given)


@ENTRIES.plant("later_degrees", caught_by="goes_on")
class LaterDegrees(Gap):
    """Gives degrees for radians from the 200th step on."""

    steps = 0

    def avoid(self, given: AvoiderInput) -> Avoidance:
        self.steps += 1
        answer = super().avoid(given)
        if self.steps < 200:
            return answer
        return Avoidance(type(answer.twist)(answer.twist.vx, 0.0, 57.0 * answer.twist.wz), answer.status)


@ENTRIES.plant("fails_later", caught_by="goes_on")
class FailsLater(Proportional):
    """Has a table that is too short for a long drive."""

    def __init__(self, params: object, context: Context) -> None:
        super().__init__(params, context)  # type: ignore[arg-type]
        self.steps, self.table = 0, np.zeros(150)

    def reset(self) -> None:
        self.steps = 0

    def control(self, given: ControllerInput) -> TrackingCommand:
        self.table[self.steps] = given.reference.cross_track
        self.steps += 1
        return super().control(given)


@ENTRIES.plant("ever_slower", caught_by="goes_on")
class EverSlower(Proportional):
    """Sums its whole past in each step."""

    steps = 0

    def control(self, given: ControllerInput) -> TrackingCommand:
        self.steps += 1
        sum(k * k for k in range(500 * self.steps))
        return super().control(given)


@ENTRIES.plant("second_reset", caught_by="reset_as_new")
class SecondReset(Proportional):
    """Resets only the first time."""

    total, resets = 0.0, 0

    def reset(self) -> None:
        self.resets += 1
        if self.resets == 1:
            self.total = 0.0

    def control(self, given: ControllerInput) -> TrackingCommand:
        self.total += 0.01
        answer = super().control(given)
        twist = answer.twist
        return TrackingCommand(type(twist)(twist.vx, 0.0, twist.wz + 0.001 * self.total), 0.0, answer.e2, answer.e3)
