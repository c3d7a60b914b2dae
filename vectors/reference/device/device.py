"""device: a CANopen device, put together of its parts: it boots, hears frames, and lets time pass."""

from can_frames import read_text
from device_errors import Errors
from device_lss import DeviceLss
from device_objects import Objects, bytes_of
from device_rpdo import Rpdo
from device_rules import IDENTIFIER, OFF, Rules
from device_sdo import DeviceServer
from device_sync import Sync
from device_tpdo import Tpdo
from device_watch import Consumer, Guarding, Heartbeat
from texts import octets

STATES = {0x01: "operational", 0x02: "stopped", 0x80: "pre-operational"}
RESETS = {0x81: "9FFF", 0x82: "1FFF"}
"""The last index that a reset restores."""


class Device:
    """A device. Times are microseconds."""

    def __init__(self, given):
        self.node, self.now, self.state, self.says = given["id"], 0, "off", []
        self.objects = Objects(given["objects"])
        self.objects.changed.append(self.changed)
        Rules(self.objects)
        self.lss = DeviceLss(self) if given.get("lss") else None
        self.errors, self.sync = Errors(self), Sync(self)
        self.heartbeat, self.consumer, self.guarding = Heartbeat(self), Consumer(self), Guarding(self)
        indices = sorted({int(place[:4], 16) for place in self.objects.entries})
        self.pdos = [Rpdo(self, index) for index in indices if 0x1400 <= index <= 0x15FF]
        self.pdos += [Tpdo(self, index) for index in indices if 0x1800 <= index <= 0x19FF]
        self.channels = [None, *(index for index in indices if 0x1201 <= index <= 0x127F)]
        self.servers = {}
        if self.node is not None:
            self.boot()

    def say(self, entry, data):
        """Send a frame; bit 29 of the entry: its identifier is extended."""
        identifier = f"{entry & 0x1FFFFFFF:08X}" if entry >> 29 & 1 else f"{entry & 0x7FF:03X}"
        self.says.append(f"{identifier}#{data.hex().upper()}")

    def boot(self):
        """Begin with the boot-up message, if there is a node-ID."""
        if self.lss:
            self.node = self.lss.node = self.lss.pending
        self.state = "off" if self.node is None else "pre-operational"
        if self.node is None:
            return
        self.say(0x700 + self.node, b"\0")
        for part in (self.heartbeat, self.consumer, self.guarding, self.sync, *self.pdos):
            part.start()
        self.sync.counter, self.errors.active, self.errors.queue = 0, {}, []
        self.objects.values["1001:00"] = b"\0"
        for place, base in (("1200:01", 0x600), ("1200:02", 0x580)):
            self.objects.values[place] = (base + self.node).to_bytes(4, "little")
        self.open_servers()

    def open_servers(self):
        """Begin to serve: a transfer that was under way is over."""
        self.servers = {channel: DeviceServer(self.objects).run() for channel in self.channels}
        for server in self.servers.values():
            next(server)

    def enter(self, state):
        """Change the NMT state."""
        before, self.state = self.state, state
        if state == "stopped":
            self.open_servers()
        if state == "operational" != before:
            for pdo in self.pdos:
                pdo.enter()

    def changed(self, place, differs):
        """An object was written."""
        for pdo in self.pdos if differs else ():
            pdo.changed(place)

    def advance(self, now):
        """Let the time pass."""
        parts = (self.heartbeat, self.consumer, self.guarding, self.sync, self.errors, *self.pdos)
        while self.state != "off":
            due = [(part.due(), number) for number, part in enumerate(parts) if part.due() is not None]
            if not due or min(due)[0] > now:
                break
            self.now = max(self.now, min(due)[0])
            parts[min(due)[1]].act(self.now)
        self.now = now

    def hear(self, text):
        """Take a frame."""
        frame = read_text({"text": text})["frame"]
        data, entry = octets(frame["data"]), int(frame["id"], 16) | frame["extended"] << 29
        if self.lss and entry == 0x7E5 and len(data) == 8:
            for answer in self.lss.feed(frame, self.now):
                self.says.append(answer)
        if self.state == "off":
            return
        if frame["remote"]:
            self.request(entry)
        elif entry == 0 and len(data) == 2:
            self.command(*data)
        elif self.state != "stopped" and entry == self.sync.entry() & IDENTIFIER:
            self.sync.hear(data, self.now)
        elif 0x701 <= entry <= 0x77F and data:
            self.consumer.hear(entry - 0x700, self.now)
        else:
            self.serve(entry, data)

    def request(self, entry):
        """A remote frame asks for the state, or for a TPDO."""
        if entry == 0x700 + self.node:
            self.guarding.hear(self.now)
        for pdo in self.pdos:
            if isinstance(pdo, Tpdo) and pdo.parameter(1) & IDENTIFIER == entry:
                pdo.request()

    def command(self, command, node):
        """An NMT command, for this node or for all."""
        if node not in (0, self.node):
            return
        if command in STATES:
            self.enter(STATES[command])
        elif command in RESETS:
            self.objects.restore(RESETS[command])
            self.boot()

    def serve(self, entry, data):
        """A frame for an SDO server, or an RPDO."""
        for channel, server in self.servers.items():
            asked, answers = self.identifiers(channel)
            if self.state != "stopped" and len(data) == 8 and entry == asked and not (asked | answers) & OFF:
                for line in server.send(data):
                    self.say(answers, line)
        for pdo in self.pdos:
            if isinstance(pdo, Rpdo) and pdo.parameter(1) & IDENTIFIER == entry:
                pdo.hear(data, self.now)

    def identifiers(self, channel):
        """Return the COB-IDs of the requests and the answers of an SDO server."""
        if channel is None:
            return 0x600 + self.node, 0x580 + self.node
        return tuple(self.objects.number(f"{channel:04X}:{sub:02X}") for sub in (1, 2))

    def act(self, action):
        """What its application does."""
        if "set" in action:
            place = action["set"]
            self.objects.put(place, bytes_of(self.objects.entries[place]["type"], action["value"]))
        elif "error" in action:
            self.errors.occur(action["error"], int(action["error"], 16), octets(action.get("info", "")))
        else:
            self.errors.end(action["clear"])


def run(given):
    """device, talk -> talk"""
    device, steps = Device(given["device"]), []
    for step in given["talk"]:
        device.advance(step["at"])
        for text in step.get("hear", ()):
            device.hear(text)
        for action in step.get("act", ()):
            device.act(action)
        steps.append({"say": device.says})
        device.says = []
    return {"talk": steps}


KINDS = {"device": {"run": run}}
