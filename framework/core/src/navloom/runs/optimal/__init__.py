"""The shortest possible path of a robot in a world, as the reference for episodes."""
