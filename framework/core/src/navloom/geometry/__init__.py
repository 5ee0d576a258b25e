"""Pure geometry on plain numbers and arrays: angles, frames, grids, footprints, collision and ground-truth worlds.

Begin with `world.py`, the true world that only a platform sees, and `frames.py`, rigid motions of the plane.
`collision.py` measures clearance exactly; `grid.py` and `cells.py` relate worlds and maps; `echoes.py` places ranges.
No module here knows a node, a plugin or a config; `compiled.py` is the one way to compile a kernel.
"""
