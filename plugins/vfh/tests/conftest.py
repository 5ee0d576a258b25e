"""Makes the drives importable: they are those of the VFF, so that both are measured on the same worlds and seeds."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "vff" / "tests"))
