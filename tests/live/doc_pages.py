"""Commands and files of README and docs, as steps in the order of each page."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

TOP = Path(__file__).resolve().parents[2]
PAGES = [TOP / "README.md", *sorted((TOP / "docs").glob("*.md")), *sorted((TOP / "docs" / "lab").glob("*.md"))]

NOT_RUN = {
    ("tour.md", "navloom place"): "puts the robot of the page where it is not",
    ("command-line.md", "navloom stop --all"): "needs a robot; test_cli_stop.py has some",
    ("operating.md", "navloom stop --all"): "would hold the robot of the page; test_cli_stop.py has some",
    ("operating.md", "navloom calibrate"): "needs a drive with turns; plugins/calibration/tests gives it some",
    ("deploying.md", "navloom stop --all"): "needs a robot; test_cli_stop.py has some",
    ("tour.md", "navloom run paper --view"): "opens a window; framework/viewer/tests looks at what it shows",
    ("studies.md", "navloom compare paper --vary avoider=vff@printed,vff,"): "3360 episodes",
    ("studies.md", "navloom compare explore"): "1800 episodes of the BARN data set",
    ("studies.md", "python benchmarks"): "350 drives of data sets that the project does not have",
    ("comparing.md", "navloom results"): "stores rows; framework/study/tests/test_suite_results.py adds some",
    ("comparing.md", "navloom compare explore --vary avoider=vfh_swept,mppi,dwa"): "450 episodes of the BARN data set",
    ("simulator-truth.md", "navloom compare"): "200 episodes of the BARN data set",
    ("simulator-truth.md", "python benchmarks"): "hours of the BARN data set; benchmarks/tests has its table",
    ("bench.md", "navloom bench --only barn"): "needs ir-sim in an environment of its own",
    ("deploying.md", "navloom up"): "needs four hosts; tests/hosts/test_four_hosts.py drives them",
    ("writing-a-driver.md", "navloom check"): "needs a robot; tests/test_hardware_check.py runs it on a played base",
    ("viewing.md", "navloom view --foxglove"): "serves until Ctrl-C; framework/viewer/tests looks at what it serves",
    ("dashboard.md", "navloom dashboard"): "serves until Ctrl-C; plugins/dashboard/tests asks it",
    ("dashboard.md", "navloom up paper"): "serves until Ctrl-C; plugins/dashboard/tests asks such a robot",
    ("deploying.md", "navloom metrics"): "serves until Ctrl-C; framework/live/tests/operating asks it",
    ("deploying.md", "docker compose"): "needs docker",
    ("deploying.md", "navloom goal"): "needs four hosts; tests/hosts/test_four_hosts.py drives them",
    ("security.md", "tar "): "needs two hosts; test_the_two_hosts_of_the_security_page copies the files itself",
    ("security.md", "cd robot && navloom up"): "needs two hosts; test_the_two_hosts_of_the_security_page plays both",
    ("security.md", "navloom up"): "needs two hosts; test_the_two_hosts_of_the_security_page plays both",
    ("security.md", "navloom goal"): "needs two hosts; test_the_two_hosts_of_the_security_page plays both",
    ("security.md", "navloom stop --connect"): "needs two hosts; test_the_two_hosts_of_the_security_page plays both",
    ("security.md", "navloom node robot.toml"): "needs a third host, and an alternative `forces` in the config",
    ("certificates.md", "navloom status --connect"): "needs an expired certificate; framework/live/tests/cli makes one",
    ("recording.md", "navloom replay run.mcap --only avoider --until 123 --pdb"): (
        "a debugger waits for its user; framework/recording/tests/test_excerpt.py types into it"
    ),
    ("nav2.md", "navloom ros"): "needs a ROS network; plugins/ros/tests plays one",
    ("ros2.md", "navloom ros"): "needs a ROS network; plugins/ros/tests plays one",
    ("ros2.md", "navloom up turtlebot.toml"): "needs a robot; plugins/ros/tests/campaign_ros2_base.py has one",
    ("ros2.md", "navloom goal"): "needs a robot; plugins/ros/tests/campaign_ros2_base.py has one",
    ("ros2.md", "navloom stop"): "needs a robot; plugins/ros/tests/campaign_ros2_base.py has one",
    ("command-line.md", "help2man"): "of a Debian package that only this page needs",
    ("installing.md", "python3 -m venv"): "tests/test_wheels.py makes such an environment",
    ("installing.md", ". navloom-env"): "tests/test_wheels.py makes such an environment",
    ("installing.md", "pip "): "asks an index; tests/test_wheels.py installs the wheels alone",
    ("installing.md", "python3 -m pip wheel"): "tests/test_wheels.py builds the wheels",
    ("installing.md", "python3 uv.py build"): "tests/test_wheels.py builds the wheels",
    ("publishing.md", "pip install"): "asks an index; tests/test_wheels.py installs plugins from a folder",
    ("publishing.md", "navloom check"): "of a plugin that is installed; the tutorial checks the same as a file",
    ("publishing.md", "navloom run building"): "of a plugin that is installed; the tutorial runs the same as a file",
    ("installing.md", "navloom run paper"): "in an environment of wheels; tests/test_wheels.py runs it there",
}  # fmt: skip
"""Commands that no test runs: page and beginning of the command -> reason."""

SHORT_STUDY = "navloom compare paper --vary avoider=improved_vfh,vff --worlds empty --seeds 0:1 --jobs 1 --out study"

PROGRAMS = {"mkdir", "navloom", "python"}
"""Programs whose commands are run unless NOT_RUN lists them."""

STAND_INS = {
    ("tour.md", "navloom paper"): "navloom paper --help",
    ("paper.md", "navloom paper"): "navloom paper --help",
    ("paper-results.md", "navloom paper"): "navloom paper --help",
    ("bench.md", "navloom bench"): "navloom bench --help",
    ("performance.md", "navloom bench"): "navloom bench --help",
    ("writing-a-plugin.md", "navloom check avoider.gap"): (
        "navloom check avoider.gap --plugin my_avoider.py --only signatures --only answers"
    ),
    ("tour.md", "navloom compare"): SHORT_STUDY,
    ("adding-worlds.md", "navloom compare"): "navloom run building --plugin pillars.py --set world.ref=two_pillars",
    ("comparing.md", "navloom compare examples/circle_swap.toml"): "navloom compare --help",
    ("moving-obstacles.md", "navloom compare swap.toml"): "navloom compare --help",
    ("moving-obstacles.md", "navloom compare examples/circle_swap.toml"): "navloom compare --help",
    ("tutorial.md", "navloom check"): "navloom check avoider.clear_way --plugin clear_way.py --list",
    ("tutorial.md", "navloom compare"): "navloom compare --help",
    ("choosing.md", "navloom compare building"): "navloom compare --help",
    ("comparing.md", "navloom compare paper --vary avoider=improved_vfh,vff"): SHORT_STUDY,
    ("comparing.md", "navloom compare --suite"): "navloom compare --help",
}  # fmt: skip
"""Slow commands: page and beginning of the command -> what is run instead, except with `-m slow`."""

TOKENS = re.compile(
    r"^<!-- (?P<direction>[^\n]*?) -->$|^```(?P<language>\w*)\n(?P<block>.*?)^```$|"
    r"`(?P<inline>(?:uv run (?:--group \w+ )*)?navloom [^`]+)`",
    re.MULTILINE | re.DOTALL,
)
PROMPT = re.compile(r"\w*\$\s+")
GROUPS = {"config", "export", "keys", "params", "results"}
"""Commands with subcommands."""
UV = re.compile(r"uv run (?:--group \w+ )*")


@dataclass(frozen=True)
class Step:
    """One thing to do on a page.

    Attributes:
        kind: command; inline, a command within the text; form, a command with placeholders or a name alone; python;
            file, to be written; set-up, run by `.ci/run`; scene, what the page assumes, from a comment `before: …`.
        text: The command as typed, the code, the file's content, or the scene.
        name: Name of the file.
        output: Lines that the page shows below the command.
    """

    page: str
    line: int
    kind: str
    text: str
    name: str = ""
    output: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.page}:{self.line}: {self.text}"


def steps(page: Path) -> list[Step]:
    text = page.read_text("utf-8")
    found: list[Step] = []
    marked = ""
    for token in TOKENS.finditer(text):
        line = text.count("\n", 0, token.start()) + 1
        if token["direction"] is not None:
            marked = token["direction"]
            if marked.startswith("before: "):
                found.append(Step(page.name, line, "scene", marked.removeprefix("before: ")))
            continue
        if token["inline"] is not None:
            command = UV.sub("", " ".join(token["inline"].split()))
            found.append(Step(page.name, line, "inline" if _is_whole(command) else "form", command))
        else:
            found += _of_block(page.name, line, token["language"], token["block"], marked)
        marked = ""
    in_blocks = {step.text for step in found if step.kind == "command"}
    return [step for step in found if step.kind != "inline" or step.text not in in_blocks]


def _is_whole(command: str) -> bool:
    """Whether a command can be run: it has arguments, and none is a placeholder."""
    parts = command.split()
    return len(parts) > (3 if parts[1] in GROUPS else 2) and re.search(r"[A-Z…|]", command) is None


def _of_block(page: str, line: int, language: str, block: str, marked: str) -> list[Step]:
    if marked in ("run", "test"):
        return [Step(page, line, "set-up", block)]
    if marked.startswith("file: "):
        return [Step(page, line, "file", block, marked.removeprefix("file: "))]
    if language == "python":
        return [Step(page, line, "python", block)]
    if language not in ("sh", "bash", "console"):
        return []
    found: list[Step] = []
    for number, text in enumerate(block.splitlines(), line + 1):
        if language == "console" and not PROMPT.match(text):
            last = found[-1]
            found[-1] = Step(page, last.line, last.kind, last.text, output=(*last.output, text))
            continue
        command = UV.sub("", re.split(r"\s+# ", PROMPT.sub("", text, count=1) if language == "console" else text)[0])
        if command.strip():
            found.append(Step(page, number, "command", command.strip()))
    return found


def listed(table: dict[tuple[str, str], str], step: Step) -> tuple[str, str] | None:
    """The table entry of a command, the one with the longest beginning; None without one."""
    found = [entry for entry in table if entry[0] == step.page and step.text.startswith(entry[1])]
    return max(found, key=lambda entry: len(entry[1]), default=None)


def needs_a_shell(command: str) -> bool:
    """Whether a command is more than a single navloom command."""
    return not command.startswith("navloom ") or re.search(r" [|>] | && ", command) is not None


def words(command: str) -> list[str]:
    """A navloom command's arguments."""
    return shlex.split(command)[1:]
