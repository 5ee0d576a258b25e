"""A robot spread over four hosts: base, brain, drive, and hub with the router; goals come from a desk."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from host_rig import Lab, Program

__all__ = ["FOUR", "NAMES", "Robot"]

FOUR = ("base", "brain", "drive", "hub")
NAMES = (*FOUR, "desk")
SHIPPED = Path(__file__).parents[2] / "framework" / "core" / "src" / "navloom" / "config" / "shipped" / "paper.toml"
SPREAD = """\
hosts = { base = ["robot", "safe"], brain = ["think"], drive = ["drive"], hub = [] }

[live.processes]
robot = ["platform", "localizer"]
think = ["mapper", "planner", "goal"]
drive = ["reference", "controller", "avoider", "recovery"]
safe = ["gate"]
"""


@dataclass
class Robot:
    """A robot spread over the hosts of a lab, with the shipped config `paper`, waiting for goals.

    Attributes:
        lab: Its hosts.
        realm, name: Realm and name of the robot.
        secure: Use TLS with its own certificates; else plain TCP.
        port: Port of its router.
    """

    lab: Lab
    realm: str = "lab"
    name: str = "r1"
    secure: bool = True
    port: int = 7447
    programs: dict[str, Program] = field(default_factory=dict)

    @property
    def motors(self) -> Path:
        """Log of each command to the motors."""
        return self.lab.folder / f"{self.name}-motors.log"

    @property
    def keys(self) -> Path:
        """Folder of its certificates."""
        return self.lab.folder / f"{self.name}-keys"

    @property
    def endpoint(self) -> str:
        return f"{'tls' if self.secure else 'tcp'}/{self.lab['hub'].address}:{self.port}"

    @property
    def options(self) -> list[str]:
        """Options with which a command on the desk reaches the robot."""
        way = ["--keys", str(self.keys)] if self.secure else ["--insecure"]
        return ["--robot", f"{self.realm}/{self.name}", "--connect", self.endpoint, *way]

    def write(self) -> Path:
        """Write its config and certificates.

        The wheels do not slip, because the robot drives for an hour on odometry alone. A campaign stops it and kills
        its processes so often that neither the time nor the number of restarts is limited.
        """
        text = SHIPPED.read_text("utf-8") + "\n"
        for old, new in (
            ("stop_after = 120.0\n", "stop_after = 1e6\n"),
            ("[robot]\n", f'[robot]\nrealm = "{self.realm}"\nname = "{self.name}"\n'),
            ('plugin = "sensors_sim"\n', f'plugin = "motor_log"\nmotor_log = "{self.motors}"\nslip = 0.0\n'),
            ("[navigation]\n", "[navigation]\ndrive = false\n"),
            ('ref = "paper_gates_obstacle"', 'ref = "paper_gates"'),
        ):
            assert old in text, f"the config paper has no {old!r} any more"
            text = text.replace(old, new, 1)
        live = f'[live]\nrouter = "{self.endpoint}"\nrouter_host = "hub"\nrestart_limit = 1000\n'
        if self.secure:
            order = ("--realm", self.realm, "--robot", self.name, "--host", self.lab["hub"].address)
            made = self.lab["hub"].run("keys", "new", str(self.keys), *order)
            assert made.returncode == 0, made.stderr
            live += f'keys = "{self.keys}"\n'
        path = self.lab.folder / f"{self.name}.toml"
        path.write_text(text + live + SPREAD, "utf-8")
        return path

    def bring_up(self) -> None:
        """`navloom up --host` on each host at once; returns when each reports that every node is there."""
        config = self.write()
        way = [] if self.secure else ["--insecure"]
        for name in FOUR:
            self.programs[name] = self.lab[name].start("up", str(config), "--host", name, *way)
        for program in self.programs.values():
            program.wait_for("every node is there")

    def take_down(self) -> dict[str, int]:
        """Press Ctrl-C on each host, the router's last; returns the exit code of each."""
        return {name: self.programs[name].end() for name in ("brain", "drive", "base", "hub")}

    def looks(self) -> str:
        """Output of `list` and `doctor` on the desk, in JSON, with the message counts of every stream."""
        desk = self.lab["desk"]
        return "\n".join(desk.run(word, "--json", *self.options).stdout for word in ("list", "doctor"))

    def shuttle(self, *places: str) -> Program:
        """A program on the desk that sends the robot to and fro between places X,Y, and prints how each goal ended."""
        desk = self.lab["desk"]
        keys = str(self.keys) if self.secure else "-"
        return desk.python("shuttle.py", f"{self.realm}/{self.name}", self.endpoint, keys, *places)
