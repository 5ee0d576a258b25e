"""Settings of all tests: properties try the same examples each time; `--hypothesis-profile=explore` tries new ones."""

from hypothesis import settings

settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("explore", deadline=None)
settings.load_profile("repeatable")
