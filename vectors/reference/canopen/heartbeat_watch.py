"""heartbeat-watch: a master that watches nodes, by their heartbeats or by node guarding. Times are microseconds."""

from can_frames import read_text
from texts import octets

BASE = 0x700


def node_and_state(frame):
    """Return the node and the byte of a boot-up message, a heartbeat or a response; None for other frames."""
    node = int(frame["id"], 16) - BASE
    if frame["extended"] or frame["remote"] or not 1 <= node <= 127 or not frame["data"]:
        return None
    return node, octets(frame["data"])[0]


class Node:
    """What is known of one node."""

    def __init__(self, number, life_time):
        self.number, self.life_time, self.deadline = number, life_time, None
        self.state = None  # None: nothing was heard, or it is lost or has booted
        self.toggle = None  # of the next response; None: either

    def tell(self, what):
        """Return an event."""
        return f"{self.number} {what}"

    def heard(self, state, now):
        """Return the events of a heartbeat or a response."""
        before, self.state = self.state, state
        if self.life_time:
            self.deadline = now + self.life_time
        if before is None:
            return [self.tell(f"active {state:02X}")]
        return [self.tell(f"state {state:02X}")] if state != before else []

    def expire(self, now):
        """Return the event of a node that was not heard in time."""
        if self.deadline is None or self.deadline > now:
            return []
        self.deadline = self.state = None
        return [self.tell("lost")]


class Consumer:
    """A consumer of heartbeats. The first one begins the watch; a boot-up message ends it until the next one."""

    def __init__(self, times):
        self.nodes = {int(number): Node(int(number), 1000 * time) for number, time in times.items()}

    def advance(self, now):
        """Return what it sends and what it reports up to this time."""
        return [], [event for node in self.nodes.values() for event in node.expire(now)]

    def hear(self, number, byte, now):
        """Return what it reports of a frame."""
        node = self.nodes.setdefault(number, Node(number, None))
        if byte:
            return node.heard(byte & 0x7F, now)
        node.deadline = node.state = None
        return [node.tell("booted")]


class Guard:
    """The master of node guarding: a request each guard time; a response within guard time times factor."""

    def __init__(self, guards):
        self.nodes, self.requests = {}, {}
        for number, guard in guards.items():
            node = self.nodes[int(number)] = Node(int(number), 1000 * guard["time"] * guard["factor"])
            node.deadline = node.life_time
            self.requests[int(number)] = (0, 1000 * guard["time"])

    def advance(self, now):
        """Return the requests that are sent, and what is reported up to this time."""
        says, events = [], []
        for number, (at, period) in self.requests.items():
            while at <= now:
                says.append(f"{BASE + number:03X}#R1")
                at += period
            self.requests[number] = (at, period)
            events += self.nodes[number].expire(now)
        return says, events

    def hear(self, number, byte, now):
        """Return what is reported of a frame."""
        if number not in self.nodes:
            return []
        node = self.nodes[number]
        if byte == 0:
            node.state, node.toggle = None, 0
            return [node.tell("booted")]
        toggle = byte >> 7
        if node.toggle not in (None, toggle):
            return [node.tell("toggle")]
        node.toggle = toggle ^ 1
        return node.heard(byte & 0x7F, now)


def run(given):
    """watch, talk -> talk"""
    watch = given["watch"]
    master = Guard(watch["guard"]) if "guard" in watch else Consumer(watch["heartbeat"])
    steps = []
    for step in given["talk"]:
        says, events = master.advance(step["at"])
        for text in step["hear"]:
            found = node_and_state(read_text({"text": text})["frame"])
            events += master.hear(*found, step["at"]) if found else []
        steps.append({"say": says, "events": events})
    return {"talk": steps}


KINDS = {"heartbeat-watch": {"run": run}}
