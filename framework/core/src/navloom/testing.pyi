from navloom_check import *  # noqa: F403
