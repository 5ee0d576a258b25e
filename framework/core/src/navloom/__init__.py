"""navloom: plugin-based navigation for mobile robots. A graph of nodes steps once a tick; plugins fill the roles.

The public names are one table, name to module; each loads only what it needs, and a part that is missing is named.
Begin with `runs/episode.py`, `run_episode`: from a config to a finished run; then `engine/lockstep.py`, `Lockstep`.
Plugins import from here and from `navloom.testing`. Live robots, recordings, studies and viewers are other parts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from navloom.names import NAMES
from navloom.parts import install_aliases, lazy_names

if TYPE_CHECKING:
    from navloom_live.operating.navigator import GoalHandle as GoalHandle
    from navloom_live.operating.navigator import Navigator as Navigator
    from navloom_viewer.panels import Panel as Panel
    from navloom_viewer.panels import Seen as Seen

    from navloom.engine.nodes.node_plugin import *  # noqa: F403
    from navloom.errors import *  # noqa: F403
    from navloom.geometry.actors import Actor as Actor
    from navloom.geometry.actors import Body as Body
    from navloom.geometry.actors import Course as Course
    from navloom.geometry.actors import Walk as Walk
    from navloom.geometry.world import *  # noqa: F403
    from navloom.messages import *  # noqa: F403
    from navloom.plugins import *  # noqa: F403
    from navloom.roles import *  # noqa: F403
    from navloom.runs.episode_trail import Trail as Trail
    from navloom.runs.metrics import *  # noqa: F403
else:
    __all__, __getattr__ = lazy_names("navloom", NAMES)

install_aliases()
