"""The command line: one file a command; what is heavy is imported when a command runs.

Begin with `main.py`: it finds the command, and turns errors into one message and an exit code.
`command.py` and `options.py` are public: commands of other distributions use the same option groups.
Commands of parts enter by the entry points `command.NAME` and are listed from metadata without an import.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from navloom.cli.main import main as main  # early, since the module of this name would take its place
from navloom.parts import lazy_names

if TYPE_CHECKING:
    from navloom.cli.command import App as App
    from navloom.cli.command import made_with as made_with
    from navloom.cli.options import AsJson as AsJson
    from navloom.cli.options import Changes as Changes
    from navloom.cli.options import ConfigName as ConfigName
    from navloom.cli.options import ConfigOptions as ConfigOptions
    from navloom.cli.options import MapOptions as MapOptions
    from navloom.cli.options import PluginFiles as PluginFiles
    from navloom.cli.options import Record as Record
    from navloom.cli.options import RobotOptions as RobotOptions
    from navloom.cli.options import RunOptions as RunOptions
    from navloom.cli.options import Shadows as Shadows
    from navloom.cli.options import ViewerOptions as ViewerOptions
    from navloom.cli.options import ViewOptions as ViewOptions
    from navloom.cli.options import a_heading as a_heading
    from navloom.cli.options import a_number as a_number
    from navloom.cli.options import seconds as seconds
    from navloom.cli.output import json_line as json_line
    from navloom.cli.output import log_of as log_of
    from navloom.cli.output import paced as paced
    from navloom.cli.output import print_json as print_json
    from navloom.cli.output import print_table as print_table
    from navloom.cli.output import progress_line as progress_line
    from navloom.cli.output import say_so as say_so
    from navloom.cli.output import stage as stage
    from navloom.entry_kinds import CommandPoint as CommandPoint
    from navloom.entry_kinds import added_commands as added_commands
else:
    __all__, __getattr__ = lazy_names(
        "navloom.cli",
        {
            "navloom.cli.command": "App made_with",
            "navloom.cli.main": "main",
            "navloom.cli.options": (
                "AsJson Changes ConfigName ConfigOptions MapOptions PluginFiles Record RobotOptions RunOptions "
                "Shadows ViewerOptions ViewOptions a_heading a_number seconds"
            ),
            "navloom.cli.output": "json_line log_of paced print_json print_table progress_line say_so stage",
            "navloom.entry_kinds": "CommandPoint added_commands",
        },
    )
