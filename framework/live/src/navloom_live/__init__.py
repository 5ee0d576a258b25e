"""Live robots: the nodes of a config in processes on the wall clock, over Zenoh, on one host or several.

Begin with `drives/live_run.py`: what `navloom up` does. Layers, lowest first: `transport` carries bytes, `live` steps
nodes, `hosting` runs processes, `operating` is what tools do from outside. Nothing below reads anything above.
`timing.py` holds the watchdogs' times; a test asserts the inequalities between them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from navloom.parts import lazy_names

if TYPE_CHECKING:
    from navloom.navigation.status_words import progress as progress
    from navloom.navigation.status_words import what_limits as what_limits
    from navloom.navigation.status_words import who_drives as who_drives
    from navloom.navigation.status_words import why_stopped as why_stopped

    from navloom_live.hosting.runtime_folders import DirectoryError as DirectoryError
    from navloom_live.hosting.runtime_folders import robots as robots
    from navloom_live.operating.client import ClientError as ClientError
    from navloom_live.operating.client import Refused as Refused
    from navloom_live.operating.diagnosis import Diagnosis as Diagnosis
    from navloom_live.operating.navigator import Navigator as Navigator
    from navloom_live.operating.stream_subscription import Listening as Listening
    from navloom_live.operating.stream_subscription import Told as Told
    from navloom_live.operating.teleoperation import Driver as Driver
    from navloom_live.operating.web_server import BindError as BindError
    from navloom_live.operating.web_server import WebServer as WebServer
    from navloom_live.operating.web_server import guarded as guarded
    from navloom_live.operating.web_server import is_loopback as is_loopback
else:
    __all__, __getattr__ = lazy_names(
        "navloom_live",
        {
            "navloom.navigation.status_words": "progress what_limits who_drives why_stopped",
            "navloom_live.hosting.runtime_folders": "DirectoryError robots",
            "navloom_live.operating.client": "ClientError Refused",
            "navloom_live.operating.diagnosis": "Diagnosis",
            "navloom_live.operating.navigator": "Navigator",
            "navloom_live.operating.stream_subscription": "Listening Told",
            "navloom_live.operating.teleoperation": "Driver",
            "navloom_live.operating.web_server": "BindError WebServer guarded is_loopback",
        },
    )
