"""Branches of the stack that a small file never takes, as texts and what stands in their place.

Each text must be there exactly once: when the stack changes under a patch, making the file fails, and names the text.
"""

from __future__ import annotations

Patch = tuple[str, str]


def _without(text: str) -> Patch:
    return text, ""


NO_LISTENER: tuple[Patch, ...] = (
    _without("""\
            elif found := self._hunt():
                events += found
"""),
    ("self._divide() or self._hunt()", "self._divide()"),
    ("self._removed + end > self._hunted and end - at", "end - at"),
    ('self.role != "listener" and len(self._held)', "len(self._held)"),
    ('self.role != "listener" and not self', "not self"),
    _without("        self._hunted = 0\n"),
    _without("""\
        self._places: list[tuple[int, int]] = []  # a heap of (number of bytes at which to check again, place)
        self._unchecked = 0  # the first place that has not been checked yet
        self._hunted = 0  # up to here no frame ends that begins behind the first byte
"""),
    _without("""\

A listener executes nothing and shows everything: where the bytes cannot be divided, it searches, byte by byte, for the
next whole frame with a good CRC, and reports the bytes before it as one Noise.
"""),
)
"""Of `rtu.line`: only a listener looks for frames behind damaged ones. For others they may be data of those."""

ONLY_RESPONSES: tuple[Patch, ...] = (
    (
        """\
                if len(sizes) == 1:
                    return end, due
                whole.append(size)
        if whole and (size := self._shape.likeliest(self._held[at], pdu, sizes, whole, may_wait)) is not None:
            return at + size + _ENVELOPE, due
""",
        "                return end, due\n",
    ),
    (
        """\
        whole: list[int] = []
        sizes = self._shape.measured(self._held[at], pdu)
        for size in sizes:
""",
        "        for size in self._shape.measured(self._held[at], pdu):\n",
    ),
    ("def _check(self, at: int, may_wait: bool = False)", "def _check(self, at: int)"),
    _without("""

        `may_wait`: return None also if the bytes are a frame, but a longer one that begins with them is more likely.
        \
"""),
    ("self._check(0, True)", "self._check(0)"),
    ('if self.role != "client" or self', "if self"),
    _without("""\
        role: Role = "client",
        units: Container[int] = (),
"""),
    _without("        self.role: Role = role\n"),
    ("Shape(role, units)", "Shape()"),
    ('f"<RtuLine: {self.role}>"', '"<RtuLine>"'),
    (
        "One line. A client receives responses. A server receives requests, and also the responses of other units.",
        "One line of a client, which receives responses.",
    ),
    ('RtuLine(Timing.of(19200), role="server")', "RtuLine(Timing.of(19200))"),
    ('feed(bytes.fromhex("01040FB1 000222F8"), now=1.0)', 'feed(bytes.fromhex("01040201 10B96C"), now=1.0)'),
    (r"pdu=b'\\x04\\x0f\\xb1\\x00\\x02'", r"pdu=b'\\x04\\x02\\x01\\x10'"),
    _without("""\
        role        "client" (default), "server", or "listener", which receives both kinds of message
        units       the server's own addresses: a frame with one of them is a request, never another unit's response
"""),
    _without("""\

Where both directions are received, the same bytes can be a whole request and a whole response, of different lengths:
a response whose CRC ends with 00 has a good CRC without that byte too. `Shape.likeliest` decides between them.
"""),
)
"""Of `rtu.line`: a client hears responses only, so bytes are never two messages, and a line has one role."""

NUMBERED: tuple[Patch, ...] = (
    (
        """\
        if not self.state.pending:
            return now
        return (yield from self._prove_gone(unit, request, timeout, now, may_probe and self.recovery == "probe"))
""",
        "        return now\n",
    ),
)
"""Of the bus: on TCP each answer has the number of its request, so none is pending, and none needs a probe."""
