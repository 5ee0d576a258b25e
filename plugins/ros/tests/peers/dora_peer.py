"""A ROS node of dora-rs, an independent implementation of the wire protocol, controlled by lines of JSON.

test_ros_peers.py runs it with the Python of the peers: `python dora_peer.py ROUTER PREFIX…`. Each line of input is a
list of an operation and its arguments; each answer is a line with `ok` or `error`.
"""

import json
import os
import sys
import tempfile
import time
import warnings

ROUTER, PREFIXES = sys.argv[1], sys.argv[2:]
os.environ["AMENT_PREFIX_PATH"] = ":".join(PREFIXES)
warnings.filterwarnings("ignore")

import dora  # noqa: E402
import pyarrow  # noqa: E402

SETTINGS = {
    "mode": "client",
    "connect": {"endpoints": [ROUTER]},
    "scouting": {"multicast": {"enabled": False}},
    "timestamping": {"enabled": True},
}


def qos(reliable=True, transient_local=False, depth=10):
    durability = dora.Ros2Durability.TransientLocal if transient_local else dora.Ros2Durability.Volatile
    return dora.Ros2QosPolicies(durability=durability, reliable=reliable, keep_last=depth)


NUMBERS = {"bool": pyarrow.bool_(), "byte": pyarrow.uint8(), "char": pyarrow.uint8(), "string": pyarrow.string()}


def arrow(shape):
    """The Arrow type of a shape: the name of a primitive, a list of one shape, or a dict of shapes by field."""
    if isinstance(shape, dict):
        return pyarrow.struct([(name, arrow(inner)) for name, inner in shape.items()])
    if isinstance(shape, list):
        return pyarrow.list_(arrow(shape[0]))
    return NUMBERS.get(shape) or getattr(pyarrow, shape)()


def struct(value_and_shape):
    value, shape = value_and_shape
    return pyarrow.array([value], type=arrow(shape))


class Peer:
    """One method per operation. Endpoints are stored by the name of their topic, service or action."""

    def __init__(self, config):
        context = dora.Ros2Context(PREFIXES, dora.Ros2Transport.zenoh("rep2016", config))
        self._node = context.new_node("dora", "/", dora.Ros2NodeOptions(rosout=False))
        self._context = context
        self._made = {}

    def publisher(self, topic, kind, options):
        topic_of = self._node.create_topic(topic, kind, qos(**options))
        self._made["pub", topic] = self._node.create_publisher(topic_of, qos(**options))

    def publish(self, topic, value):
        self._made["pub", topic].publish(struct(value))

    def stream(self, topic, value, rate, count):
        message, began = struct(value), time.monotonic()
        for number in range(count):
            time.sleep(max(0.0, began + number / rate - time.monotonic()))
            self._made["pub", topic].publish(message)

    def subscription(self, topic, kind, options):
        topic_of = self._node.create_topic(topic, kind, qos(**options))
        self._made["sub", topic] = self._node.create_subscription(topic_of, qos(**options))

    def take(self, topic, timeout):
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            if (message := self._made["sub", topic].next()) is not None:
                return message.to_pylist()[0]
            time.sleep(0.002)
        return None

    def server(self, name, kind):
        self._made["srv", name] = self._node.create_service_server(name, kind, qos())

    def answer(self, name, value, timeout):
        taken = self._made["srv", name].take_request(timeout_s=timeout)
        if taken is None:
            return None
        self._made["srv", name].send_response(taken[0], struct(value))
        return taken[1].to_pylist()[0]

    def call(self, name, kind, value):
        client = self._node.create_service_client(name, kind, qos())
        return client.call(struct(value), timeout_s=10.0).to_pylist()[0]

    def action_server(self, name, kind):
        self._made["action", name] = self._node.create_action_server(name, kind, qos())

    def take_goal(self, name, timeout):
        taken = self._made["action", name].take_goal(timeout_s=timeout)
        return None if taken is None else [taken[0], taken[1].to_pylist()[0]]

    def feedback(self, name, goal, value):
        self._made["action", name].send_feedback(goal, struct(value))

    def take_cancel(self, name, timeout):
        return self._made["action", name].take_cancel(timeout_s=timeout)

    def finish(self, name, goal, value, status):
        self._made["action", name].send_result(goal, struct(value), status=status, timeout_s=10.0)

    def action_client(self, name, kind):
        self._made["user", name] = self._node.create_action_client(name, kind, qos())

    def send_goal(self, name, value):
        return self._made["user", name].send_goal(struct(value), timeout_s=10.0)

    def take_feedback(self, name, goal, timeout):
        taken = self._made["user", name].take_feedback(goal, timeout_s=timeout)
        return None if taken is None else taken.to_pylist()[0]

    def take_result(self, name, goal, timeout):
        taken = self._made["user", name].take_result(goal, timeout_s=timeout)
        return None if taken is None else [taken[0], taken[1].to_pylist()[0]]

    def cancel(self, name, goal):
        return self._made["user", name].cancel(goal, timeout_s=10.0)


def main():
    with tempfile.NamedTemporaryFile("w", suffix=".json5") as config:
        json.dump(SETTINGS, config)
        config.flush()
        peer = Peer(config.name)
        print(json.dumps({"ok": "ready"}), flush=True)
        for line in sys.stdin:
            operation, *arguments = json.loads(line)
            try:
                answer = {"ok": getattr(peer, operation)(*arguments)}
            except Exception as error:
                answer = {"error": f"{type(error).__name__}: {str(error)[:2000]}"}
            print(json.dumps(answer, default=repr), flush=True)


main()
