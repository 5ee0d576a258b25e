"""The shortest possible path of a robot in a world: what an episode is measured against."""
