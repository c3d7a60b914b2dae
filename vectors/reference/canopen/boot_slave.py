"""boot-slave: how a CANopen manager boots one node (CiA 302-2). A generator yields a frame and is sent what comes."""

from can_frames import read_text
from texts import octets

IDENTITY = (("vendor", 1, "D"), ("product", 2, "M"), ("revision", 3, "N"), ("serial", 4, "O"))
OPERATIONAL = 0x05


class Fails(Exception):
    """The process ends with a letter."""


class Manager:
    """The process for one node: `heard` are the frames that nobody has waited for yet."""

    def __init__(self, slave):
        self.slave, self.node, self.heard = slave, slave["node"], []

    def say(self, identifier, data):
        """Say a frame."""
        self.heard += yield f"{identifier:03X}#{data.hex().upper()}"

    def wait(self, identifier):
        """Return the data of the next frame with this identifier; None: its time-out passes."""
        while self.heard:
            frame = read_text({"text": self.heard.pop(0)})["frame"]
            if frame["id"] == f"{identifier:03X}":
                return octets(frame["data"])
        return None

    def asked(self, command, place, data):
        """Return the response to an SDO request; None if there is none, or an abort."""
        yield from self.say(0x600 + self.node, (bytes([command]) + place + data).ljust(8, b"\0"))
        answer = self.wait(0x580 + self.node)
        return None if answer is None or answer[0] == 0x80 else answer

    def read(self, index, sub):
        """Return a number of the node, None if it cannot be read."""
        answer = yield from self.asked(0x40, index.to_bytes(2, "little") + bytes([sub]), b"")
        return None if answer is None else int.from_bytes(answer[4:], "little")  # all are UNSIGNED32

    def write(self, place, data):
        """Write up to four bytes; return whether the node has taken them."""
        index, sub = (octets(text)[::-1] for text in place.split(":"))
        return (yield from self.asked(0x23 | 4 - len(data) << 2, index + sub, data)) is not None

    def guarded(self):
        """Say a request of node guarding; return the state in the response, None without one."""
        self.heard += yield f"{0x700 + self.node:03X}#R1"
        answer = self.wait(0x700 + self.node)
        return None if answer is None else answer[0] & 0x7F

    def heartbeat(self):
        """Return the state in the next heartbeat; None: there is none in its time."""
        while (data := self.wait(0x700 + self.node)) is not None:
            if data[0]:
                return data[0]
        return None

    def boot(self):
        """Go through the four steps; return the end."""
        if not self.slave.get("listed", True):
            return "A"
        if not self.slave.get("boot", True):
            return (yield from self.control("ok"))
        yield from self.identify()
        if self.slave.get("keep_alive"):
            if (yield from self.is_operational()):
                return (yield from self.control("L"))
            yield from self.say(0x000, bytes([0x82, self.node]))
            if self.wait(0x700 + self.node) != b"\0":
                raise Fails("E")
        yield from self.configure()
        return (yield from self.control("ok"))

    def identify(self):
        """Step 1: compare the device type and the identity."""
        found = yield from self.read(0x1000, 0)
        if found is None:
            raise Fails("B")
        if found != int(self.slave.get("device_type", f"{found:08X}"), 16):
            raise Fails("C")
        for name, sub, letter in IDENTITY:
            if name in self.slave and (yield from self.read(0x1018, sub)) != int(self.slave[name], 16):
                raise Fails(letter)

    def is_operational(self):
        """Step 2: ask the node for its state."""
        if "heartbeat" in self.slave:
            state, letter = self.heartbeat(), "E"
        else:
            state, letter = (yield from self.guarded()), "F"
        if state is None:
            raise Fails(letter)
        return state == OPERATIONAL

    def configure(self):
        """Step 3: write what the node shall have, unless its date says that it has it."""
        if "date" in self.slave and "writes" in self.slave:
            found = []
            for sub in (1, 2):
                found.append((yield from self.read(0x1020, sub)))
                if found[-1] is None:
                    break  # there is no 1020h
            if found == self.slave["date"]:
                return
        for row in self.slave.get("writes", ()):
            if not (yield from self.write(row["object"], octets(row["bytes"]))):
                raise Fails("J")

    def control(self, end):
        """Step 4: begin error control."""
        if "heartbeat" in self.slave and self.heartbeat() is None:
            raise Fails("K")
        if "guard_time" in self.slave:
            yield from self.guarded()
        return end


def run(given):
    """slave, talk -> talk, ends"""
    process, steps, ends = Manager(given["slave"]).boot(), [{} for _ in given["talk"]], "it says more"
    try:
        says = next(process)
        for step, row in zip(given["talk"], steps):
            row["say"] = says
            says = process.send(step["hear"])
    except StopIteration as stop:
        ends = stop.value
    except Fails as fails:
        ends = fails.args[0]
    return {"talk": steps, "ends": ends}


KINDS = {"boot-slave": {"run": run}}
