"""device, LSS: a slave that can store, gives itself a new node-ID, and boots with it. The rest is in node_talk.py."""

from node_talk import LssSlave

NO_NODE = 0xFF
BIT_RATES = (0, 1, 2, 3, 4, 6, 7, 8, 9)


class DeviceLss(LssSlave):
    """The slave of a device; its address is 1018h."""

    def __init__(self, device):
        address = [device.objects.number(f"1018:{sub:02X}", 0) for sub in (1, 2, 3, 4)]
        super().__init__({"address": [f"{part:08X}" for part in address], "id": device.node})
        self.device, self.pending = device, device.node

    def answered(self, service, body, value):
        """Return the bytes of the answer to a service; None for none."""
        if self.configuring and service == 0x11:
            if not (1 <= body[0] <= 127 or body[0] == NO_NODE):
                return [0x11, 1]
            self.pending = None if body[0] == NO_NODE else body[0]
            return [0x11, 0]
        if self.configuring and service == 0x13:
            return [0x13, 0 if body[0] == 0 and body[1] in BIT_RATES else 1]
        if self.configuring and service == 0x17:
            return [0x17, 0]
        answer = super().answered(service, body, value)
        if service == 0x04 and not self.configuring and self.node is None and self.pending is not None:
            self.device.boot()
        return answer
