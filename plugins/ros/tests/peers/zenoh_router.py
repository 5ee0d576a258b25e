"""A Zenoh router in place of `rmw_zenohd`, for campaign_ros2_base.py: `python zenoh_router.py ENDPOINT`."""

import json
import sys
import time

import zenoh

SETTINGS = {
    "mode": "router",
    "listen": {"endpoints": [sys.argv[1]]},
    "scouting": {"multicast": {"enabled": False}},
    "timestamping": {"enabled": True},
}
session = zenoh.open(zenoh.Config.from_json5(json.dumps(SETTINGS)))
print("ready", flush=True)
while True:
    time.sleep(60.0)
