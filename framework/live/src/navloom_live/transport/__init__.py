"""The network of a robot: sessions, links, keys, access rules, certificates and quality of service.

Begin with `zenoh_bus.py`, what a process publishes, subscribes to and asks; `connection.py` outlasts broken sessions.
`keyspace.py` names every key. `zenoh_session.py` is the only module that imports Zenoh.
`access.py` and `certificate_folder.py` decide who may do what; `query_limits.py` bounds what anybody may ask,
and `idempotent_requests.py` does a repeated request once.
"""
