"""A client over time, in front of the peer of client_peer.py, in virtual time. Times are integer microseconds.

After a question without an answer on a serial line it listens until that answer cannot come any more, `late_window`
after the request, before it asks the same unit again. On TCP the transaction number tells whose an answer is.
"""

from checks import crc16, lrc
from client_peer import ClientPeer, unwrapped, wrapped
from texts import octets, unpacked, worded

NEVER = 1 << 60
TURNAROUND = 100_000


class Client:
    def __init__(self, case):
        self.setup = case["line"]
        self.asks = case["ask"]
        self.serial = self.setup["framing"] != "tcp"
        self.character = 11_000_000 // self.setup["baud"] if self.serial else 0
        self.peer = ClientPeer(case)
        self.now = 0
        self.number = self.setup.get("first_number", 1) - 1
        self.open = []  # questions under way: place, number, attempts, until
        self.outcomes = {}
        self.clear_at = {}  # unit -> when its late answers cannot come any more
        self.echo = self.received = b""
        self.received_at = 0

    def run(self):
        waiting = list(range(len(self.asks)))
        while waiting or self.open:
            may_ask = waiting and len(self.open) < self.setup.get("at_once", 1)
            ask_at = self.may_send_at(waiting[0]) if may_ask else NEVER
            ends_at = min((question["until"] for question in self.open), default=NEVER)
            comes_at = self.peer.coming[0][0] if self.peer.coming else NEVER
            self.now = max(self.now, min(ask_at, ends_at, comes_at))
            if comes_at <= min(ask_at, ends_at):
                self.receive(self.peer.coming.pop(0)[1])
            elif ends_at <= ask_at:
                self.time_out(next(question for question in self.open if question["until"] == ends_at))
            else:
                self.ask(waiting.pop(0))
        return [{"outcome": self.outcomes[place], "seen": self.peer.seen[place]} for place in range(len(self.asks))]

    def may_send_at(self, place):
        return max(self.now, self.asks[place]["at"], self.clear_at.get(self.asks[place]["unit"], 0))

    def ask(self, place):
        self.peer.begin(place)
        self.open.append({"place": place, "attempts": 0})
        self.send(self.open[-1])

    def send(self, question):
        ask = self.asks[question["place"]]
        self.number = (self.number + 1) % 0x10000
        frame = wrapped(self.setup["framing"], ask["unit"], ask["pdu"], self.number)
        self.now += len(frame) * self.character
        self.echo, self.received = frame if self.setup.get("echo") else b"", b"" if self.serial else self.received
        self.peer.hear(frame, self.now)
        is_broadcast = self.serial and ask["unit"] == 0
        wait = self.setup.get("turnaround", TURNAROUND) if is_broadcast else self.setup["timeout"]
        question.update(number=self.number, attempts=question["attempts"] + 1, sent=self.now, until=self.now + wait)

    def time_out(self, question):
        ask = self.asks[question["place"]]
        if self.serial and ask["unit"] == 0:
            self.end(question, "sent")
            return
        if self.serial:
            self.clear_at[ask["unit"]] = question["sent"] + self.setup["late_window"]
        if question["attempts"] > self.setup["retries"]:
            self.end(question, "no answer")
            return
        self.now = self.may_send_at(question["place"])
        self.peer.coming = [(at, data) for at, data in self.peer.coming if at > self.now]  # too late
        self.send(question)

    def end(self, question, outcome):
        self.outcomes[question["place"]] = outcome
        self.open.remove(question)
        self.peer.end(question["place"])

    def receive(self, data):
        if self.echo and data.startswith(self.echo):
            data, self.echo = data[len(self.echo) :], b""
        if self.setup["framing"] == "rtu" and self.is_pause_before(data):
            self.received = b""
        self.received += data
        self.received_at = self.now
        for unit, pdu, number in self.frames():
            for question in list(self.open):
                ask = self.asks[question["place"]]
                if ask["unit"] == unit and (self.serial or question["number"] == number):
                    outcome = outcome_of(octets(ask["pdu"]), pdu)
                    if outcome:
                        self.end(question, outcome)

    def is_pause_before(self, data):
        """Whether t3.5 has passed between the last character and the first one of these bytes."""
        return self.now - len(data) * self.character - self.received_at > 7 * self.character // 2

    def frames(self):
        """The frames that have come: unit, PDU and transaction number of each."""
        found = []
        if self.setup["framing"] == "rtu":
            data = self.received
            if len(data) > 3 and crc16(data[:-2]) == int.from_bytes(data[-2:], "little"):
                found, self.received = [unwrapped("rtu", data)], b""
        elif self.setup["framing"] == "ascii":
            *lines, self.received = self.received.split(b"\r\n")
            for line in lines:
                _, _, digits = line.rpartition(b":")
                try:
                    data = bytes.fromhex(digits.decode())
                except ValueError:
                    continue
                if len(data) > 2 and lrc(data[:-1]) == data[-1]:
                    found.append((data[0], data[1:-1], 0))
        else:
            while len(self.received) > 6 and len(self.received) >= 6 + self.received[5]:
                frame, self.received = self.received[: 6 + self.received[5]], self.received[6 + self.received[5] :]
                if frame[2:5] != b"\0\0\0" or frame[5] < 2:  # no MBAP header: connect again
                    self.received = b""
                    self.peer.coming.clear()
                    break
                found.append(unwrapped("tcp", frame))
        return found


def outcome_of(request, response):
    """The outcome that a response means; None if it does not answer the request."""
    function, count = request[0], int.from_bytes(request[3:5], "big")
    if response[0] == function | 0x80 and len(response) == 2:
        return f"exception {response[1]:02X}"
    if response[0] != function:
        return None
    if function in (1, 2):
        size = (count + 7) // 8
        if len(response) != 2 + size or response[1] != size:
            return None
        return "bits " + "".join(str(bit) for bit in unpacked(response[2:], count))
    if function in (3, 4):
        if len(response) != 2 + 2 * count or response[1] != 2 * count:
            return None
        return "registers " + worded(int.from_bytes(response[at : at + 2], "big") for at in range(2, 2 + 2 * count, 2))
    return "done" if response == request[:5] else None


def run(given):
    return {"ask": Client(given).run()}


KINDS = {"client": {"run": run}}
