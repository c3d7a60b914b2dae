"""device, error control: heartbeats 1017h, heartbeat consumer 1016h, node guarding and life guarding 100Ch, 100Dh."""

from device_objects import fields

STATES = {"stopped": 0x04, "operational": 0x05, "pre-operational": 0x7F}


class Heartbeat:
    """The producer."""

    def __init__(self, device):
        self.device, self.next = device, None
        device.objects.changed.append(self.changed)

    def changed(self, place, _):
        """The period begins again when it is written."""
        if place == "1017:00":
            self.start()

    def start(self):
        """Begin a period."""
        period = 1000 * self.device.objects.number("1017:00", 0)
        self.next = self.device.now + period if period else None

    def due(self):
        """Return when the next heartbeat is sent."""
        return self.next

    def act(self, now):
        """Send a heartbeat."""
        self.device.say(0x700 + self.device.node, bytes([STATES[self.device.state]]))
        self.start()


class Consumer:
    """The consumer: it watches a node from its first heartbeat on."""

    def __init__(self, device):
        self.device, self.deadlines = device, {}
        device.objects.changed.append(self.changed)

    def start(self):
        """Forget what was heard."""
        self.deadlines = {}

    def changed(self, place, _):
        """An entry is written: it waits for the first heartbeat again."""
        if place[:4] == "1016":
            self.start()

    def times(self):
        """Return the time of each node, in microseconds."""
        objects = self.device.objects
        entries = [fields(objects.number(place), 2, 2) for place in objects.rows("1016")]
        return {node: 1000 * time for node, time in entries if node and time}

    def hear(self, node, now):
        """Take a heartbeat."""
        if node in self.times():
            self.deadlines[node] = now + self.times()[node]
            self.device.errors.end(("heartbeat", node))

    def due(self):
        """Return when the next node is lost."""
        return min(self.deadlines.values(), default=None)

    def act(self, now):
        """A node is lost."""
        node = min(self.deadlines, key=self.deadlines.get)
        del self.deadlines[node]
        self.device.errors.lost(("heartbeat", node), bytes([node]))


class Guarding:
    """Node guarding: the device answers its master, and watches it."""

    def __init__(self, device):
        self.device, self.toggle, self.asked_at = device, 0, None

    def start(self):
        """Begin with toggle 0, and wait for the first request."""
        self.toggle, self.asked_at = 0, None

    def hear(self, now):
        """Answer a request, which ends the error of a lost master."""
        self.device.errors.end("guarding")
        if not self.device.objects.number("1017:00", 0):
            state = STATES[self.device.state] | self.toggle << 7
            self.device.say(0x700 + self.device.node, bytes([state]))
            self.toggle ^= 1
            self.asked_at = now

    def due(self):
        """Return when the life time is over."""
        number = self.device.objects.number
        life_time = 1000 * number("100C:00", 0) * number("100D:00", 0)
        return self.asked_at + life_time if self.asked_at is not None and life_time else None

    def act(self, now):
        """The master is lost."""
        self.asked_at = None
        self.device.errors.lost("guarding", b"")
