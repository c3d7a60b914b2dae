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

CLIENT_OR_SERVER: tuple[Patch, ...] = (
    (
        '"client" (default), "server", or "listener", which receives both kinds of message',
        '"client" (default) or "server"',
    ),
)
"""Of `rtu.line`."""
TWO_ROLES: tuple[Patch, ...] = (
    ('Role = Literal["client", "server", "listener"]', 'Role = Literal["client", "server"]'),
    _without("    a listener                    receives both\n"),
)
"""Of `rtu.shape`."""

ONE_KIND_OF_UNIT: tuple[Patch, ...] = (
    _without("""\
        if not hasattr(unit, "handle"):
            return self._pass_on(adu, unit, answered)
"""),
    ("AnyUnit: TypeAlias = Unit | PduUnit", "AnyUnit: TypeAlias = Unit"),
    ("self._transactions - self.caller.open_requests", "self._transactions"),
    _without("            self._latest = event\n"),
    _without("""\
        self.caller = Caller() if caller is None else caller
        self._send_later = send_later
        self._wait_for = wait_for
        self._latest: Adu | None = None  # the latest request on a serial line: only that may be answered later
"""),
    _without("""\
        caller: Caller | None = None,
        send_later: Callable[[Reply, Caller], None] | None = None,
        wait_for: Callable[[Awaitable[bytes | None]], LaterResponse] | None = None,
"""),
    _without("""\
    caller          the client, for units that are a `PduUnit`
    send_later      called as send_later(reply, caller) with the reply of a `LaterResponse`; without it a unit that
                    returns one has failed
    wait_for        makes a `LaterResponse` of what an `async def handle_pdu` returns; without it that is a failure too
"""),
    (
        """\
        answer: Response = ExceptionResponse(pdu[0] | EXCEPTION_BIT, declined.code)
        if isinstance(declined, SdoAborted):
            answer = ExtendedExceptionResponse(declined.abort_code)
        data = answer.encode()
""",
        "        data = ExceptionResponse(pdu[0] | EXCEPTION_BIT, declined.code).encode()\n",
    ),
)
"""Of the server: no units that get bytes and answer later, which a gateway has, and no SDO behind Modbus."""

PLAIN_EXAMPLES: tuple[Patch, ...] = (
    ("table.handle(registers.WriteSingleRegister(5, 42)", "table.handle(WriteSingleRegister(5, 42)"),
    ("table.handle(combined.ReadWriteMultipleRegisters(4, 2", "table.handle(ReadWriteMultipleRegisters(4, 2"),
)
"""Of the table: in one file messages have no module."""

TABLE_WITHOUT: dict[str, tuple[Patch, ...]] = {
    "identification": (
        _without("""\
        vendor: str = "barewire",
        product: str = "table",
        revision: str = "1",
        objects: Mapping[int, str | bytes] | None = None,
"""),
        _without("""\
        others = dict(_dict("objects", objects, "{128: 'serial 42'}"))
        self.identity = Identity({0: vendor, 1: product, 2: revision} | others)
"""),
        _without("""\
        vendor, product, revision    the three mandatory identification objects
        objects                      further identification objects: number -> text or bytes
"""),
        ('Table(objects={0x80: "serial 42"})', "Table()"),
    ),
    "files": (
        _without("        files: Mapping[int, Sequence[int]] | None = None,\n"),
        _without("""\
        self.files = {number: _file(number, content) for number, content in _dict("files", files, "{1: [0, 0]}")}
"""),
        _without("        files                        file records: file number -> registers\n"),
    ),
    "fifo": (
        _without("        self.queues: dict[int, list[int]] = {}\n"),
        (
            """ The application may set
    `queues` (registers by address) and `exception_status` (eight bits).
""",
            "\n",
        ),
    ),
    "combined": (
        _without("""\
    >>> table.handle(ReadWriteMultipleRegisters(4, 2, write_address=4, registers=(7,)), now=0.0)
    ReadWriteMultipleRegistersResponse(registers=(7, 42))
"""),
    ),
    "diagnostics": (_without("        self.exception_status = 0\n"),),
}
"""Of the table of a server, by the family of messages that the file does not have."""
