"""gateway: from Modbus TCP to an RTU line, whose only master it is. Times are microseconds.

client --"00 07 0000 0006 05 03 006B 0003"--> gateway --"05 03 006B 0003" and CRC--> line
       <--"00 07 0000 ...  05 03 ..."--------         <--"05 03 ..." and CRC--------
"""

from frames import encode_rtu, encode_tcp
from lines import RtuLine, TcpLine
from texts import octets

BAUD, BITS, PATIENCE = 19200, 11, 30_000
CHARACTER = 1_000_000 * BITS // BAUD
SILENCE = 7 * CHARACTER // 2
TURNAROUND = 100_000
NO_LINE, NO_RESPONSE = 0x0A, 0x0B


class Gateway:
    """The requests wait in a row; the first one is on the line until its response, its time-out or its turnaround."""

    def __init__(self, setup):
        self.setup, self.says, self.waiting = setup, [], []
        self.present, self.until, self.free_at = None, 0, 0
        self.clients = {"1": TcpLine(), "2": TcpLine()}
        self.line, self.is_up = RtuLine("response", BAUD, BITS, PATIENCE), True

    def advance(self, now):
        """Do what time brings."""
        while True:
            if self.present and self.until <= now:
                self.end()
            elif not self.present and self.waiting and self.free_at <= now:
                self.begin(self.waiting.pop(0))
            else:
                return

    def begin(self, request):
        """Put a request onto the line as soon as it is free."""
        unit, is_broadcast = request["unit"], request["unit"] == 0 and self.setup.get("broadcast")
        if not self.is_up:
            self.decline(request, NO_LINE)
        elif not is_broadcast and unit not in self.setup["units"]:
            self.decline(request, NO_RESPONSE)
        else:
            frame = encode_rtu(request)["frame"]
            self.says.append({"to": "line", "bytes": frame})
            self.present = request
            sent = max(self.free_at, request["at"]) + len(octets(frame)) * CHARACTER
            self.until = sent + (TURNAROUND if is_broadcast else self.setup["timeout"])

    def end(self):
        """The time-out of the request on the line, or the turnaround of a broadcast."""
        if self.present["unit"]:
            self.decline(self.present, NO_RESPONSE)
        self.present, self.free_at = None, self.until

    def decline(self, request, code):
        """Answer a request with an exception."""
        self.reply(request, f"{octets(request['pdu'])[0] | 0x80:02X} {code:02X}")

    def reply(self, request, pdu):
        """Answer a request: its transaction number and its unit come back."""
        self.says.append({"to": request["from"], "bytes": encode_tcp(request | {"pdu": pdu})["frame"]})

    def hear(self, step, now):
        """Take what has come from a client or from the line."""
        if "port" in step:
            self.is_up = step["port"] == "up"
            if self.present and not self.is_up:
                self.decline(self.present, NO_LINE)
                self.present = None
        elif step.get("from") == "line":
            for event in self.line.feed(octets(step["bytes"]), now):
                if "pdu" in event and self.present and answers(event, self.present):
                    self.reply(self.present, event["pdu"])
                    self.present, self.free_at = None, now + SILENCE
        elif "from" in step:
            for event in self.clients[step["from"]].feed(octets(step["bytes"]), now):
                self.waiting.append(event | {"from": step["from"], "at": now})


def answers(response, request):
    """Return whether a frame of the line is from the unit that is asked, for its function or as an exception to it."""
    function = octets(response["pdu"])[0]
    return response["unit"] == request["unit"] and function & 0x7F == octets(request["pdu"])[0]


def run(given):
    """gateway, talk -> talk"""
    gateway, steps = Gateway(given["gateway"]), []
    for step in given["talk"]:
        gateway.says = []
        gateway.advance(step["at"])
        gateway.hear(step, step["at"])
        gateway.advance(step["at"])
        steps.append({"say": gateway.says})
    return {"talk": steps}


KINDS = {"gateway": {"run": run}}
