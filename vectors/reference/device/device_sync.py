"""device, SYNC: produced by 1005h bit 30 each 1006h microseconds, counted up to 1019h; and consumed."""

from device_rules import PRODUCES


class Sync:
    """Producer and consumer."""

    def __init__(self, device):
        self.device, self.next, self.counter, self.came_at = device, None, 0, None
        device.objects.changed.append(self.changed)

    def entry(self):
        """Return the identifier with its flags."""
        return self.device.objects.number("1005:00", 0x80)

    def changed(self, place, _):
        """A period begins when it is written."""
        if place in ("1005:00", "1006:00"):
            self.start()

    def start(self):
        """Begin a period and a window."""
        period = self.device.objects.number("1006:00", 0)
        self.next = self.device.now + period if period and self.entry() & PRODUCES else None
        self.came_at = None

    def due(self):
        """Return when the next SYNC is produced."""
        return self.next

    def act(self, now):
        """Produce a SYNC; none in stopped, where the counter begins again."""
        self.next += self.device.objects.number("1006:00")
        if self.device.state == "stopped":
            self.counter = 0
            return
        highest = self.device.objects.number("1019:00", 0)
        self.counter = self.counter % highest + 1 if highest else 0
        data = bytes([self.counter]) if highest else b""
        self.device.say(self.entry(), data)
        self.hear(data, now)

    def hear(self, data, now):
        """Take a SYNC: it has a counter exactly if 1019h says so."""
        if len(data) != (1 if self.device.objects.number("1019:00", 0) else 0):
            self.device.errors.occur("sync", 0x8240, bytes([len(data)]))
            return
        self.device.errors.end("sync")
        self.came_at = now
        for pdo in self.device.pdos:
            pdo.sync(data[0] if data else None)

    def is_in_window(self, now):
        """Return whether the synchronous window 1007h is open."""
        window = self.device.objects.number("1007:00", 0)
        return not window or self.came_at is None or now - self.came_at <= window
