"""device, errors: emergencies, the error register 1001h, the history 1003h, the error behaviour 1029h."""

from device_rules import OFF

CLASSES = ((0x20, 0x2F, 0x03), (0x30, 0x3F, 0x05), (0x40, 0x4F, 0x09), (0x81, 0x82, 0x11), (0xFF, 0xFF, 0x81))
"""First and last high byte of a code, and the bits of 1001h that such an error sets; others set the generic bit."""


def bits_of(code):
    """Return the bits of 1001h that an error sets."""
    return next((bits for first, last, bits in CLASSES if first <= code >> 8 <= last), 0x01)


class Errors:
    """The errors that are active, and the emergencies that wait for the inhibit time."""

    def __init__(self, device):
        self.device, self.objects = device, device.objects
        self.active, self.queue, self.free_at = {}, [], 0

    def occur(self, key, code, info=b""):
        """An error occurs; `key` tells it from others of the same code. It is reported once."""
        if key in self.active:
            return
        self.active[key] = code
        self.remember(code, info)
        self.report(code, info)

    def end(self, key):
        """An error is gone."""
        if self.active.pop(key, None) is not None:
            self.report(0, b"")

    def report(self, code, info):
        """Send an emergency with the register of now, or let it wait. In stopped nothing is sent."""
        register = 0
        for active in self.active.values():
            register |= bits_of(active)
        self.objects.values["1001:00"] = bytes([register])
        if self.device.state != "stopped":
            self.queue.append(code.to_bytes(2, "little") + bytes([register]) + info.ljust(5, b"\0"))
            self.act(self.device.now)

    def remember(self, code, info):
        """Put an error into the history, the newest first."""
        places = self.objects.rows("1003")
        if places:
            entry = code.to_bytes(2, "little") + info.ljust(2, b"\0")[:2]
            values = self.objects.values
            row = [entry, *(values[place] for place in places)]
            values |= dict(zip(places, row))
            values["1003:00"] = bytes([min(values["1003:00"][0] + 1, len(places))])

    def due(self):
        """Return when the next emergency may be sent."""
        return self.free_at if self.queue else None

    def act(self, now):
        """Send what may be sent."""
        while self.queue and self.free_at <= now:
            entry = self.objects.number("1014:00", 0x80 + self.device.node)
            data = self.queue.pop(0)
            if not entry & OFF:
                self.device.say(entry, data)
            self.free_at = now + 100 * self.objects.number("1015:00", 0)

    def lost(self, key, info):
        """A node or the master was not heard in time: an operational device changes its state by 1029h:01."""
        self.occur(key, 0x8130, info)
        if self.device.state == "operational":
            behaviour = self.objects.number("1029:01", 0)
            self.device.enter({0: "pre-operational", 2: "stopped"}.get(behaviour, "operational"))
