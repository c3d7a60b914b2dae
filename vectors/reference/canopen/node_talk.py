"""node-talk: a device that is asked by node guarding, and an LSS slave."""

from can_frames import read_text
from texts import octets


class GuardedNode:
    """A pre-operational device that answers remote frames, and watches its master."""

    def __init__(self, setup):
        self.asked_by = {"id": f"{0x700 + setup['id']:03X}", "extended": False, "remote": True}
        self.life_time, self.toggle, self.deadline, self.lost = setup.get("life_time"), 0, None, False

    def feed(self, frame, at):
        """Return what the device says and tells up to this time."""
        if frame is None or any(frame[name] != value for name, value in self.asked_by.items()):
            if self.deadline is not None and at >= self.deadline and not self.lost:
                self.lost = True
                return ["lost"]
            return []
        told = ["resolved"] if self.lost else []
        self.lost = False
        if self.life_time:
            self.deadline = at + self.life_time
        state = self.toggle << 7 | 0x7F
        self.toggle ^= 1
        return [*told, f"{self.asked_by['id']}#{state:02X}"]


class LssSlave:
    """An LSS slave without storage."""

    def __init__(self, setup):
        self.address, self.node = [int(part, 16) for part in setup["address"]], setup["id"]
        self.configuring, self.selected, self.identified, self.scanned = False, 0, 0, None

    def feed(self, frame, at):
        """Return the answer to a frame, or nothing."""
        if frame is None or frame["id"] != "7E5" or frame["remote"]:
            return []
        data = octets(frame["data"])
        answer = self.answered(data[0], data[1:], int.from_bytes(data[1:5], "little"))
        return [] if not answer else [f"7E4#{bytes(answer).ljust(8, bytes(1)).hex().upper()}"]

    def answered(self, service, body, value):
        """Return the bytes of the answer to a service; None for none."""
        if service == 0x04:
            self.configuring = body[0] == 1
        elif 0x40 <= service <= 0x43 and not self.configuring:
            return self.select(service - 0x40, value)
        elif 0x46 <= service <= 0x4B:
            return self.identify(service - 0x46, value)
        elif service == 0x4C and self.node is None:
            return [0x50]
        elif service == 0x51 and self.node is None and not self.configuring:
            return self.scan(value, *body[4:])
        elif self.configuring and service == 0x11:
            right = 1 <= body[0] <= 127 or body[0] == 0xFF
            return [0x11, 0 if right else 1]
        elif self.configuring and 0x5A <= service <= 0x5D:
            return [service, *self.address[service - 0x5A].to_bytes(4, "little")]
        elif self.configuring and service == 0x5E:
            return [service, 0xFF if self.node is None else self.node]
        elif self.configuring and service == 0x17:
            return [0x17, 1]
        return None

    def select(self, part, value):
        """Count the parts of the address that have come in their order."""
        self.selected = part + 1 if part == self.selected and value == self.address[part] else 0
        if self.selected < 4:
            return None
        self.configuring, self.selected = True, 0
        return [0x44]

    def identify(self, step, value):
        """Compare vendor, product, and the limits of revision and serial number, in their order."""
        own = self.address[(0, 1, 2, 2, 3, 3)[step]]
        fits = (value == own, value == own, value <= own, value >= own, value <= own, value >= own)[step]
        self.identified = step + 1 if fits and step == self.identified else 0
        if self.identified < 6:
            return None
        self.identified = 0
        return [0x4F]

    def scan(self, value, bit, part, following):
        """Compare the bits of one part from 31 down to `bit`. 80h begins a scan."""
        if bit == 0x80:
            self.scanned = 0
            return [0x4F]
        if bit > 31 or part > 3 or following > 3 or part != self.scanned:
            return None
        if (value ^ self.address[part]) >> bit:
            return None
        self.scanned = following
        if bit == 0 and following < part:
            self.configuring, self.scanned = True, None
        return [0x4F]


def run(given):
    """node, talk -> talk"""
    setup = given["node"]
    machine = GuardedNode(setup) if setup["machine"] == "guarded-node" else LssSlave(setup)
    steps = []
    for step in given["talk"]:
        frame = None if step["hear"] is None else read_text({"text": step["hear"]})["frame"]
        steps.append({"said": machine.feed(frame, step["at"])})
    return {"talk": steps}


KINDS = {"node-talk": {"run": run}}
