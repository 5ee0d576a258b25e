"""Messages of a robot without a network, for tests of what `ros2_base` makes of them."""

from types import SimpleNamespace

from ros_golden import KILTED

SECOND = 1_000_000_000


class Said:
    """Messages by topic; each is taken once."""

    def __init__(self):
        self.waiting = {}

    def say(self, name, kind, sent_ns, arrived_ns, **values):
        message = KILTED.new(kind, **values)
        heard = SimpleNamespace(message=message, source_ns=sent_ns, gid=b"one", arrived_ns=arrived_ns)
        self.waiting.setdefault(name, []).append(heard)

    def take(self, name):
        yield from self.waiting.pop(name, [])


def stamp(nanoseconds):
    return {"sec": nanoseconds // SECOND, "nanosec": nanoseconds % SECOND}
