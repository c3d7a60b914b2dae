"""Branches of the stack that a small file never takes, as texts and what stands in their place.

Each text must be there exactly once: when the stack changes under a patch, making the file fails, and names the text.
"""

from __future__ import annotations

Patch = tuple[str, str]


_PROMPT = ">" * 3  # so that no test takes a patch for an example


def _without(text: str) -> Patch:
    return text, ""


NO_LISTENER: tuple[Patch, ...] = (
    _without("""\
            elif inside := self._hunt():
                events += inside
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
    (
        """\
        patience: float | None = PATIENCE,
    ) -> None:
""",
        """\
        patience: float | None = PATIENCE
    ) -> None:
""",
    ),
    _without("        self.role: Role = role\n"),
    ("Shape(role, units)", "Shape()"),
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

NO_FOLDING: tuple[Patch, ...] = (
    _without("""\
    if len(data) >= FOLD_FROM:
        return crc16_folded(data)
    # The loop of crc16_table, inlined: for a frame of eight bytes the call would take a tenth of the time.
"""),
)
"""Of the CRC: the table, also for long frames."""

NO_EXPLANATION: tuple[Patch, ...] = (("self.response.fields(pdu)", "self.response.layout.fields(pdu)"),)
"""Of the base of messages: offsets come from the layout alone."""
NO_SHORTCUTS: tuple[Patch, ...] = (
    _without("""\

Reads of registers are the most frequent requests, so `ReadHoldingRegisters` has shortcuts: see `_SHORTCUTS` below.
"""),
)
"""Of the registers."""
ONE_ENGINE: tuple[Patch, ...] = (
    _without("""\

There are three interpreters: the blocking engine, the asyncio engine (both in `io.engine`), and `Wire` below, which
runs conversations in virtual time for tests. All three give these words the same meaning.
"""),
)
"""Of conversations."""

NUMBERED: tuple[Patch, ...] = (
    _without("""\
        if self.state.pending:
            now = yield from self._prove_gone(unit, request, timeout, now, may_probe and self.recovery == "probe")
            now = yield from self._pause(unit_state, timeout, now)  # after a probe too
"""),
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
        _without(f"""\
    {_PROMPT} table.handle(ReadWriteMultipleRegisters(4, 2, write_address=4, registers=(7,)), now=0.0)
    ReadWriteMultipleRegistersResponse(registers=(7, 42))
"""),
    ),
    "diagnostics": (_without("        self.exception_status = 0\n"),),
}
"""Of the table of a server, by the family of messages that the file does not have."""

NO_BLOCKS: tuple[Patch, ...] = (
    (
        "BlockUploadResponse | DownloadInitiated | BlockDownloadInitiated | Abort",
        "UploadResponse | DownloadInitiated | Abort",
    ),
    (
        """\
    *BLOCK_UPLOAD_RESPONSES,
    DownloadInitiated,
    BlockDownloadInitiated,
""",
        """\
    *UPLOAD_RESPONSES,
    DownloadInitiated,
""",
    ),
    ("(SdoSegment, SegmentTaken, BlockAck, BlockEnd, BlockEnded)", "(SdoSegment, SegmentTaken)"),
    (
        """\
decode_one_of(bytes.fromhex("A2 02 7F 00 00 00 00 00"), RECEIVER_MESSAGES)
    BlockAck(sequence=2, blksize=127)
""",
        """\
decode_one_of(bytes.fromhex("60 00 21 00 00 00 00 00"), (DownloadInitiated,))
    DownloadInitiated(index=8448, sub=0)
""",
    ),
    ("is_any_response(BlockEnded().encode())", "is_any_response(SegmentTaken(0).encode())"),
    _without("""\

A block transfer: up to 127 segments in a row for one acknowledgement.   [CiA 301, SDO block]

        c  this side supports the CRC (used only if both do); in a segment: this is the last one
        q  number of the segment in its block, from 1

               client                                    server                            byte 0
        InitiateBlockDownload  110- -cs0    ->                                             C6 C4 C2 C0
                                            <-    BlockDownloadInitiated  101- -c00        A4 A0
        InitiateBlockUpload    101- -c00    ->                                             A4 A0
                                            <-    BlockUploadInitiated    110- -cs0        C6 C4 C2 C0
        StartBlockUpload       101- --11    ->                                             A3

               sender of the value                       receiver of the value
        BlockSegment           cqqq qqqq    ->                                             01 ... 7F, last: 81 ... FF
                                            <-    BlockAck                101- --10        A2
        BlockEnd               110n nn-1    ->                                             C1 C5 ... DD
                                            <-    BlockEnded              101- --01        A1

In a download the client is the sender, in an upload the server. There is no segment 0, so 80h is an abort inside a
block too. Only BlockEnd states how many bytes of the last segment are data.
"""),
)
"""Of the messages of SDO: none of block transfers."""

NO_MONITOR: tuple[Patch, ...] = (
    _without("        node_monitor: NodeMonitor | None = None,\n"),
    _without("        self.node_monitor = node_monitor\n"),
    _without("        self._mark: TrafficMark | None = None\n"),
    _without("        self._mark = None if self.node_monitor is None else self.node_monitor.mark(self.response_id)\n"),
    ("self.rival = channel._rival_until(timeout)", "self.rival = _PAST"),
    _without("""\
        if self.quiet_for is not None and self._was_answered(place):
            self.note_answer(place)
            return _PAST
"""),
    (
        """\
        if self.node_monitor is None or self._mark is None:
            return self.counters.explain(self.node, self.response_id)
        monitor, count = self.node_monitor, self.counters.responses
        text = monitor.explain_silence(self.node, self.response_id, self._mark, now, responses=count)
        return ", ".join([text, *self.counters.oddities()])
""",
        "        return self.counters.explain(self.node, self.response_id)\n",
    ),
    ('("_mark", "_plain"', '("_plain"'),
    ('                 "node_monitor", "own_frames"', '                 "own_frames"'),
    _without("        dialect: SdoDialect = STANDARD,\n"),
    _without("        self.dialect = dialect\n"),
    ('"busy", "counters", "dialect", "node"', '"busy", "counters", "node"'),
    (
        """\
 A bus that passes
a channel only its own frames gives it a `node_monitor`, which explains a time-out by what the node sent before.
""",
        "\n",
    ),
)
"""Of the channel: one client on one port sees all frames itself, and every device has the dialect of the standard."""
