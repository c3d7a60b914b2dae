"""What a text without bytes says: an error message of a program, a log that was not set to show the frames.

        "Modbus Error: [Input/Output] No Response received"  -->  no-bytes: no answer in time; how pymodbus logs bytes

Such a text proves nothing about a line or bus, so that the one verdict is `no-bytes`. It shows the words that are
known, what they mean where a program wrote them (the port is closed, a device refused, no answer came), and how that
program is told to log its bytes. Whether a program wrote them, or a person who means something else, is not known.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from itertools import chain
from typing import NamedTuple

from barewire.canopen.abort_codes import AbortCode, abort_text
from barewire.canopen.emcy import error_text
from barewire.modbus.exceptions import exception_name
from barewire_workbench.diagnosis.exchange import shown_digits
from barewire_workbench.diagnosis.fragments import floats_of, pieces_of, readings_of
from barewire_workbench.diagnosis.verdict import LineVerdict
from barewire_workbench.recordings.modbus_log import LoggedBytes, ModbusLog

_SHOWN = 8
"""Pieces of bytes that a verdict shows."""
NO_WHOLE_FRAMES = "the bytes are no whole frames, and no traffic is seen"
"""What the verdict says of data, or of a few bytes in a sentence."""
_LONG = 14
"""Characters of a text that is no word of every message."""
_REFUSAL, _LONGEST_ANSWER, _MOST_REGISTERS = 5, 255, 125
"""Bytes of an exception and of the longest answer on a serial line, and the registers in that."""
_UNDECIDED = frozenset({"nothing-wrong", "open", "not-seen", "nothing-heard", "no-frames", "refused"})
_CHECKSUM_FAILS = re.compile(
    r"(?i)(?:crc|checksum|lrc)\W{0,3}(?:\w+ ){0,2}(?:err|fail|wrong|invalid|mismatch|incorrect|bad|does not|differ|!=)|"
    r"(?:wrong|invalid|bad|incorrect|no) (?:crc|checksum|lrc)"
)
_GENERAL_FORMS = ("marked", "blocks", "bytes")
"""Forms that any program may have written: a word and hexadecimal digits are enough."""
_SHORTEST, _REQUEST = 4, 8
"""Bytes of the shortest frame, and of a request to read."""
_CANDUMP = "candump -L can0 > bus.log, and ip -details -statistics link show can0"
_PROGRAMS: tuple[tuple[str, str, str], ...] = (
    (
        "Home Assistant",
        r"homeassistant|custom_components|SyncWorker_\d|configuration\.yaml|Pymodbus: \w+: |hass\b",
        "in configuration.yaml the lines `logger:`, `  logs:`, `    pymodbus: debug`",
    ),
    (
        "Node-RED",
        r"contribModbus|node-red|modbus-getter|modbus-client|\bFSM \w+",
        "DEBUG=contribModbus*,modbus-serial node-red -v",
    ),
    ("evcc", r"\bevcc\b|\[site *\]|\[lp-\d|cannot create (?:meter|charger|vehicle)", "evcc --log trace"),
    ("openHAB", r"(?i)openhab", "in its console log:set TRACE net.wimpi.modbus"),
    ("ioBroker", r"(?i)iobroker|Poll error count|\bmodbus\.\d+ \(", "the log level debug (or silly) of the instance"),
    ("modbus-proxy", r"modbus-proxy|modbus_proxy", "the level DEBUG in its logging section"),
    (
        "Telegraf",
        r"telegraf|\[inputs\.modbus\]",
        'log_level = "trace" in [[inputs.modbus]] (older: debug_connection = true), and --debug',
    ),
    (
        "ESPHome",
        r"\[[CDVWE]\]\[\w+(?:\.\w+)*:\d+\]",
        "under `uart:` the lines `debug:`, `  direction: BOTH`, and `level: DEBUG` under `logger:`",
    ),
    ("mbpoll", r"mbpoll|-- Polling slave", "mbpoll -v"),
    ("mbusd", r"\bmbusd\b", "mbusd -d -v 9"),
    ("pyModbusTCP", r"pyModbusTCP", 'logging.getLogger("pyModbusTCP").setLevel(logging.DEBUG)'),
    ("esp-modbus", r"MB_(?:CONTROLLER|PORT|TCP|SERIAL)|mb[cm]_\w+|mb_port", 'esp_log_level_set("*", ESP_LOG_DEBUG)'),
    (
        "modbus-esp8266",
        r"modbus-esp8266|ModbusRTU\.h|ModbusIP_ESP|\bEX_[A-Z_]{5,}|Modbus::ResultCode",
        "its onRaw callback, or a second adapter at the line",
    ),
    ("eModbus", r"eModbus|ModbusClient(?:RTU|TCP)|handleError", "the build flag -DLOG_LEVEL=6"),
    (
        "NModbus",
        r"NModbus|Modbus\.(?:\w+\.)*\w*Exception\b",
        "a ConsoleModbusLogger(LoggingLevel.Trace) for ModbusFactory",
    ),
    ("tokio-modbus", r"tokio[-_]modbus", "RUST_LOG=trace"),
    (
        "pymodbus",
        r"pymodbus|Modbus Error: \[|ModbusIOException|\[Input/Output\]|Exception Response\(",
        'pymodbus_apply_logging_config("DEBUG"); before version 3 logging.basicConfig(level=logging.DEBUG)',
    ),
    ("minimalmodbus", r"(?i:minimalmodbus)|No communication with the instrument", "instrument.debug = True"),
    (
        "modbus_tk",
        r"modbus_tk|ModbusInvalidResponseError",
        'create_logger("console") of modbus_tk.utils, and set_verbose(True)',
    ),
    ("jsmodbus", r"jsmodbus|\berr: '\w+', message:|\berrorCode: \d+, exceptionCode", "DEBUG=* node program.js"),
    (
        "modbus-serial",
        r"modbus-serial|Data length error, expected|TransactionTimedOut|PortNotOpen|Modbus exception \d+:|"
        r"^(?:Error: )?CRC error|RTUBufferedPort",
        "DEBUG=modbus-serial node program.js",
    ),
    (
        "the Modbus library for Go",
        r"modbus: (?:response|exception|send)|dial tcp|read tcp",
        'handler.Logger = log.New(os.Stdout, "", log.LstdFlags)',
    ),
    (
        "libmodbus",
        r"CRC received \w+ != CRC calculated|timed out: select|Time Out: select|modbus-rtu\.c|modbus_read_\w+",
        "modbus_set_debug(ctx, TRUE)",
    ),
    ("CANopenNode", r"canopend|CO_\w+|#SDO protocol timed out", _CANDUMP),
    (
        "canopen",
        r"canopen\.|canopen[/\\]|Sdo(?:Aborted|Communication)Error|boot-?up message|wait_for_bootup|statusword|"
        r"trying to change state|(?i:no sdo response|aborted by client with code)",
        _CANDUMP,
    ),
    (
        "a program on CAN",
        r"(?i)socketcan|\bv?can\d\b|Can(?:Operation|Initialization)?Error|No buffer space|canopen|abort code|"
        r"\bSDO\b|\bPDO\b|\bNMT\b|\bEMCY\b|bus[- ]?off|heartbeat|boot-?up|Transition timeout|"
        r"\bcan[-_ ]?bus|slcan|mcp[-_]?2515|\btwai\b|flexcan|fdcan|bxcan|"
        r"stuff(?:ing)? error|(?-i:\bCAN\b)|\b(?:11|29)[- ]?bit\b",
        _CANDUMP,
    ),
)
"""Programs by the words of their messages, and how each is told to show its bytes. The first that fits counts: those
that use the library of another come before it."""
_ANY_PROGRAM = "of TCP by tcpdump -i any -w line.pcap port 502, of a serial line by barewire sniff at a second adapter"

_SILENT, _CHECKSUM, _LENGTH = "no answer came in time", "a checksum was wrong", "an answer had another length"
_OTHER_UNIT = "an answer came from another unit"
_QUEUE_FULL = "frames cannot be sent, since the send queue of the interface is full"
_NOT_ACKNOWLEDGED = "no other node acknowledges what is sent"
_EQUAL = "the checksum received and the one calculated are equal, so that the program refuses a good frame"
_UART = "the UART reports errors of parity or framing, or a break"


def _result_code(code: str) -> str:
    """Return the pattern of a code as the examples of ModbusMaster and modbus-esp8266 print it: alone in a line, or
    behind a word; among other bytes it is one of them."""
    words = r"err\w*|result\w*|code|event|status|returns?|failed|failure"
    return rf"(?im:(?:^\s*|\b(?:{words})\b\W{{0,4}}(?:is |of )?)(?:0x)?{code}\s*(?:$|[^\w\s]|(?=\s[g-z])))"


_STATED: tuple[tuple[str, str], ...] = (
    (
        r"(?i)connection (?:\w+ )?refused|refused (?:the |to )?connect|ECONNREFUSED|Errno 111",
        "the connection is refused: nothing listens on the port, or no further client is taken",
    ),
    (r"unreachable|No route to host|EHOSTUNREACH", "the host is not reached"),
    (
        r"(?i)could not open port|no such file|cannot open|Port Not Open|Port is (?:not open|closed)|No such device",
        "the port or interface cannot be opened",
    ),
    (
        r"(?i)permission denied|access (?:is )?denied|resource busy|already (?:open|in use)|"
        r"\bEBUSY|\bEACCES|multiple access",
        "another program has the port, or this one may not open it",
    ),
    (r"(?i)network is down|ENETDOWN", "the interface is not up"),
    (
        r"(?i)acknowledge?(?:ment)?[- ]error|no[- ]ack\b|not acknowledged|only one node|alone on the (?:can|bus)|"
        r"only node|all ?tx ?busy",
        _NOT_ACKNOWLEDGED,
    ),
    (r"(?i)\bstuff(?:ing)?\b|form[- ]error", "frames are damaged on the bus: errors of stuffing or form"),
    (r"(?i)No buffer space|ENOBUFS|\bErr(?:no|or Code) 105\b|CANsend\) Transmitting", _QUEUE_FULL),
    (r"(?i)bus[- ]?off", "the CAN controller has left the bus for errors"),
    (r"(?i)error[- ]passive", "the CAN controller is error passive"),
    (r"Errno -[235]\]|getaddrinfo|Name or service", "the name of the host is not known"),
    (
        r"unexpectedly closed|: EOF\b|reset by peer|ECONNRESET|IncompleteReadError|[Cc]onnection (?:lost|closed)",
        "the other side closed the connection",
    ),
    (
        r"Failed to connect|connect failed|dial tcp .*timeout|failed: timed out|FSM|Port Not Open|could not open",
        "there is no connection",
    ),
    (r"\bCRC|_CRC|[Cc]hecksum|\bLRC\b", _CHECKSUM),
    (
        r"[Ll]ength error|data size|WRONG_BYTES|"
        r"(?i:unexpected byte count|length is invalid|invalid (?:\w+ )?length|incomplete|too short)|"
        r"not corresponding|count does not match|expected \d+ (?:bytes )?(?:but )?got \d+",
        _LENGTH,
    ),
    (r"[Uu]nable to decode", "an answer was not understood"),
    (
        r"(?i)(?:slave|unit|device) id '?\d+'? does not match|ask for (?:dev_)?id=|was expected but slave|"
        r"not from requested slave|wrong (?:slave|unit|device)",
        _OTHER_UNIT,
    ),
    (r"(?i)(?:uart|serial|rx|receive)\W{1,3}(?:\w+\W{1,3})?(?:parity|framing|frame) err|\b(?:rx|uart) break\b", _UART),
    (r"ctx->slave != -1", "libmodbus has no unit to ask: it refuses those above 247 itself, and nothing was sent"),
    (
        r"Cleanup recv buffer before send",
        "bytes of an earlier answer were in the buffer when the next request was sent: it came late",
    ),
    (r"NOT REQUESTED transaction", "an answer has a transaction number that no request has that waits"),
    (
        r"(?i)received (\w+)\W+calculated \1\b",
        _EQUAL,
    ),
    (_result_code("E0"), "an answer came from another unit (ModbusMaster's E0)"),
    (_result_code("E1"), "an answer has another function (ModbusMaster's E1)"),
    (
        r"(?i)no (?:\w+ ){0,2}(?:response|answer|reply)|(?<![\w.])time[ds]?[-_ ]?out(?!\w|\.\w|\W{0,2}[=:(]\W*\d)|"
        rf"{_result_code('E[24]')}|"
        r"(?:not|n't) (?:receive|respond|answer|get(?! (?:\w+ ){1,3}work))|no communication|offline",
        _SILENT,
    ),
)
"""What words mean in a message of a program, most telling first."""
_TOLD_APART: dict[str, tuple[str, str]] = {
    _SILENT: (
        "another unit or other settings, exchanged wires, a driver not switched (DE, RTS), a device that is off",
        "barewire scan tries units and settings; a second adapter shows whether the request is on the line",
    ),
    _CHECKSUM: (
        "bytes lost or added while the direction changes, another parity, noise, or a program that takes other bytes",
        "the bytes of one answer show which",
    ),
    _LENGTH: (
        "a refusal (5 bytes on a serial line), bytes lost or added, or a device with longer registers",
        "the bytes of one answer show which",
    ),
    _OTHER_UNIT: (
        "a device that answers as another unit, a late answer, or another master on the line",
        "ask the unit that answers; if that is good, it is the first",
    ),
    _UART: (
        "another parity or baud rate than the sender, exchanged wires, or noise: the settings of both sides first",
        "a reader with the other parity and half or twice the baud rate shows whether frames appear",
    ),
    _QUEUE_FULL: (
        "no other node acknowledges, or a queue that is too short for what is sent at once",
        "candump -e shows error frames in the first case; in the second `ip link set can0 txqueuelen 1000` helps",
    ),
    _NOT_ACKNOWLEDGED: (
        "no other node that is on and has this bit rate (of CAN FD both), or the wiring",
        "a second adapter with candump at the same bit rate: if that acknowledges, the other node is the cause",
    ),
}
"""What may be behind the words, and the observation that tells it apart."""
_SILENT_ON_CAN = (
    "a node that is off, stopped or has another node-ID, another bit rate, or the wiring",
    "candump shows whether the request is on the bus and whether any node sends",
)
_IS_MESSAGE = re.compile(
    r"(?i)err|fail|exception|time[- ]?d?[- ]?out|result|refused|respon|answer|abort|offline|duplicate|reset|"
    r"no buffer|match|wrong|invalid|unable|cannot|denied|lost|closed|\bdown\b|\bbusy\b|bus[- ]?off|"
    r"modbus|slave|canopen|\bsdo\b|wait_for|illegal|\bEX_|acknowledg|\bstuff|\b0xE[0-9]\b"
)
"""Words of programs on a line or bus, and of failures; a text without them is no message of either."""
_FIELD = re.compile(
    r"(?i)\brs-?(?:485|422|232)\b|\bmodbus|\bcan[-_ ]?bus|canopen|slcan|(?-i:\bCAN\b|\bRTU\b|\b[SP]DO\b)|\bregisters?\b"
)
_FAILURE = re.compile(
    r"(?i)n['’]?t\b|\bcannot\b|\bnever\b|\bstops?\b|\balways\b|\bproblem|\btrouble|\bstuck\b|\bhangs?\b"
)
"""Words of people on a line or bus, and on a failure: a text with one of each is a message too."""
_IS_DEBUG = re.compile(r"\b(?:DEBUG|TRACE)\b|\b[DV] \(\d+\) |\[(?:VV?|D)\]")
_PROSE = re.compile(r"(?:\b[A-Za-z']{2,}\b,? +){4}")
"""Words of a sentence: bytes beside them may be a part of a frame, or an example."""
_NUMBER = re.compile(r"(?i)exception[ _]?(?:code)?[\"']?\s*[:=]?\s*[('\"]*(0x[0-9a-f]{1,2}|\d{1,2})\b(?!\d)(?!,)")
_NAMES = {
    "illegalfunction": 1,
    "illegaladdress": 2,
    "illegaldataaddress": 2,
    "illegalvalue": 3,
    "illegaldatavalue": 3,
    "slavefailure": 4,
    "devicefailure": 4,
    "slavebusy": 6,
    "devicebusy": 6,
    "serverfailure": 4,
    "serverbusy": 6,
    "memoryparityerror": 8,
    "gatewaypathunavailable": 10,
    "gatewaypathsunavailable": 10,
    "gatewaynoresponse": 11,
    "targetdevicefailedtorespond": 11,
}
_NAME = re.compile(
    r"(?i)illegal[ _]?(?:function|(?:data[ _]?)?(?:address|value))|(?:slave|server|device)[ _]?(?:failure|busy)|"
    r"gateway[ _]?(?:no[ _]?response|paths?[ _]?unavailable)|memory[ _]?parity[ _]?error|"
    r"target[ _]?device[ _]?failed[ _]?to[ _]?respond"
)
_EXCEPTION = re.compile(r"Exception Response\(|exceptionCode|SlaveException")
_ABORT = re.compile(r"\b(?:0x|(?<=\())(0[568][0-9A-Fa-f]{6})\b")
_ABORT_TEXTS = {code.text.partition(",")[0].lower(): code for code in AbortCode if len(code.text) > _LONG}
_EMERGENCY = re.compile(r"(?i)\berror ?code\W{1,3}0x([0-9a-f]{4})\b")
_UNIT = re.compile(r"(?i)(?:(?:slave|unit|server)(?: address| id)? out of range \(|-- Polling slave )(\d{3,})\b")
_LENGTHS = re.compile(
    r"(?i)(?:length|bytes?|size|short|long)\b.{0,40}?expected (\d+),? (?:but )?(?:got|received) (\d+)|"
    r"expected (\d+) bytes,? (?:but )?(?:got|received) (\d+)"
)
_LAST_UNIT = 247
_NO_VALUE = re.compile(
    r"(?i)(?:\[|=|\b(?:values?|reads?|returns?|shows?|got|get|gives?|is|always)\b:?) ?(65535|32767|-?32768)\b(?![.,]\d)"
)
"""A value that the text gives, and not a limit or a port."""
_TRANSACTIONS = re.compile(
    r"transaction[ _]id '?(\d+)'? does not match request '?(\d+)|ask for transaction_id=(\d+) but got id=(\d+)"
)


class _Stated(NamedTuple):
    """What words mean in a message of a program, the words, and the number of their line."""

    what: str
    words: str
    line: int

    @classmethod
    def by(cls, words: re.Match[str], what: str) -> _Stated:
        """Return what matched words mean."""
        return cls(what, " ".join(words.group().split()), words.string.count("\n", 0, words.start()) + 1)


def _said(stated: list[_Stated]) -> str:
    """Return the known words of a text with their meaning: that they stand there is certain, that a program wrote them
    is not."""
    if not stated:
        return "no message that is known stands in the text"
    told = "; ".join(f'"{words}" (line {line}): {what}' for what, words, line in stated)
    return f"in messages of programs these words mean: {told}"


def verdict_without_bytes(text: str) -> LineVerdict | None:
    """Return the verdict on a text that holds no bytes; None if it is no message.

    >>> verdict_without_bytes("Modbus Error: [Input/Output] No Response received from the remote unit").code
    'no-bytes'
    """
    is_message = _IS_MESSAGE.search(text) or (_FIELD.search(text) and _FAILURE.search(text))
    pieces = pieces_of(text)
    readings = readings_of(text, pieces)
    is_prose = 0 < max(map(len, pieces), default=0) < _REQUEST and _PROSE.search(text) is not None
    if "\0" in text or not (is_message or readings or is_prose):
        return None
    stated = _stated(text)
    program, how = _program(text, stated)
    said = _said(stated)
    log = f"a log of {program} with its bytes: {how}" if program else f"a log with bytes: {how}"
    if readings:
        return LineVerdict("not-seen", NO_WHOLE_FRAMES, "; ".join([*readings[:_SHOWN], *([said] if stated else [])]))
    if pieces:
        what = f"{', '.join(map(shown_digits, pieces[:_SHOWN]))}; {said}{_apart(stated, how)}; to get {log}"
        text = NO_WHOLE_FRAMES if is_prose else "the bytes in the text are no frames that are read"
        return LineVerdict("not-seen", text, what)
    return LineVerdict(
        "no-bytes", "there are no bytes, so that no cause is proved", f"{said}{_apart(stated, how)}; to get {log}"
    )


def verdict_of_words(text: str, codes: Collection[str]) -> LineVerdict | None:
    """Return what the words beside the bytes state, as said and not seen; None if they state nothing, or if `codes`,
    those of the diagnosis, name a cause."""
    if "\0" in text or set(codes) - _UNDECIDED:
        return None
    stated = _stated(text)
    if "nothing-wrong" in codes or "refused" in codes:
        stated = [known for known in stated if known.what != _SILENT]  # the bytes show it
    floats = [] if "canopen" in text.lower() else list(floats_of(text, pieces_of(text)))[:_SHOWN]
    if floats:
        return LineVerdict("said", "the words beside the bytes are said, not seen", "; ".join(floats))
    if not stated:
        return None
    against = ""
    meanings = {known.what for known in stated}
    if _CHECKSUM in meanings and set(codes) <= {"nothing-wrong", "open", "refused"}:
        against = (
            "; each checksum that is read fits: the program checks other bytes than it prints, or checks them wrongly"
        )
    elif _LENGTH in meanings and set(codes) <= {"nothing-wrong"}:
        against = (
            "; the answer that is read has the length that was asked: another is meant, or the program expects more"
        )
    evidence = f"{_said(stated)}{against or _apart(stated, _program(text, stated)[1])}"
    return LineVerdict("said", "the words beside the bytes are said, not seen", evidence)


def _stated(text: str) -> list[_Stated]:
    """Return what the words of a text mean in messages of programs, each meaning once, with the first words of it."""
    found = ((re.search(words, text), what) for words, what in _STATED)
    known = [*_numbered(text), *(_Stated.by(words, what) for words, what in found if words)]
    by_meaning = {stated.what: stated for stated in reversed(known)}
    failed = _CHECKSUM_FAILS.search(text)
    if _CHECKSUM in by_meaning and (failed is None or _EQUAL in by_meaning):
        del by_meaning[_CHECKSUM]
    return [*reversed(by_meaning.values())]


def _program(text: str, stated: Collection[_Stated]) -> tuple[str, str]:
    """Return the program that wrote a text, and how it logs its bytes; an empty name if no word tells."""
    program = next(((name, how) for name, words, how in _PROGRAMS if re.search(words, text, re.MULTILINE)), None)
    if program is not None and program[1] != _CANDUMP and _IS_DEBUG.search(text):
        return program[0], f"{program[1]}; if that is set already, {_ANY_PROGRAM}"
    if program is not None:
        return program
    is_can = any(known.what.startswith("a node ") for known in stated)
    return ("a program on CAN", _CANDUMP) if is_can else ("", _ANY_PROGRAM)


def _apart(stated: list[_Stated], how: str) -> str:
    """Return what may be behind the most telling words, if they leave it open, and how to tell. `how` is the way to
    get the bytes of the program."""
    what = stated[0].what if stated else ""
    is_can = what == _SILENT and how == _CANDUMP
    causes, observation = _SILENT_ON_CAN if is_can else _TOLD_APART.get(what, ("", ""))
    return f"; behind such a message, where the text does not exclude it: {causes}; {observation}" if causes else ""


def is_text(log: ModbusLog) -> bool:
    """Return whether the bytes that were read from words are no frame and too few for one: digits of a message.

    >>> from barewire_workbench.recordings.modbus_log import read_modbus_log
    >>> is_text(read_modbus_log(b"0x03 (RES) Exception (2): Illegal Data Address"))
    True
    """
    items = [item for item in log.items if isinstance(item, LoggedBytes)]
    pieces = [len(item.data) for item in items]
    is_few = max(pieces, default=0) < _SHORTEST and sum(pieces) < _SHORTEST * 2
    is_name = len(pieces) == 1 and pieces[0] < _SHORTEST * 2 and items[0].protocol is None  # of an adapter, or a number
    return log.form in _GENERAL_FORMS and (is_few or is_name)


def _numbered(text: str) -> list[_Stated]:
    """Return what the numbers in a message state: exceptions, abort codes, transactions."""
    stated: list[_Stated] = []
    exceptions: dict[int, re.Match[str]] = {}
    for words in chain(_NAME.finditer(text), _NUMBER.finditer(text)):
        name = re.sub(r"[ _]", "", words.group()).lower()
        number = _NAMES[name] if words.re is _NAME else int(words[1], 16 if words[1][:2].lower() == "0x" else 10)
        exceptions.setdefault(number, words)
    for number, words in sorted(exceptions.items()):
        if number in range(1, 12):
            by = "a gateway" if number in (10, 11) else "a device"
            stated.append(
                _Stated.by(words, f"{by} is reached and refuses: exception {number:02X} ({exception_name(number)})")
            )
    if not stated and (exception := _EXCEPTION.search(text)):
        stated.append(_Stated.by(exception, "a device is reached and refuses with an exception"))
    aborts = {int(words[1], 16): words for words in _ABORT.finditer(text)}
    if not aborts and "bort" in text:
        named = ((code, re.search(f"(?i){re.escape(name)}", text)) for name, code in _ABORT_TEXTS.items())
        aborts = {int(code): words for code, words in named if words}
    is_own = re.search(r"(?i)by (?:the )?client", text) is not None
    for code, words in sorted(aborts.items()):
        by = "the client gave up" if is_own or code == AbortCode.TIMED_OUT else "a node refuses"
        stated.append(_Stated.by(words, f"{by}: abort {code:08X} ({abort_text(code)})"))
    for words in _EMERGENCY.finditer(text):
        error = f"{words[1]}h ({error_text(int(words[1], 16))})"
        stated.append(_Stated.by(words, f"a node reports the emergency {error}"))
    for words in _UNIT.finditer(text):
        if int(words[1]) > _LAST_UNIT:
            other = "a register?" if int(words[1]) > _LONGEST_ANSWER else "248 to 255 are reserved"
            stated.append(_Stated.by(words, f"unit {words[1]} is asked, which is none: 1 to 247 are; {other}"))
    for words in _NO_VALUE.finditer(text):
        marks = f"{int(words[1]) & 0xFFFF:04X}h, which many devices send for a value that they do not have"
        stated.append(_Stated.by(words, f"{words[1]} is {marks}"))
    for words in _LENGTHS.finditer(text):
        expected, got = map(int, filter(None, words.groups()))
        if got == _REFUSAL < expected:
            stated.append(_Stated.by(words, f"5 bytes came where {expected} were expected: the length of a refusal"))
        if expected > _LONGEST_ANSWER:
            asked = (expected - _REFUSAL) // 2
            stated.append(_Stated.by(words, f"{asked} registers are asked, and {_MOST_REGISTERS} are the most"))
    return [*stated, *_transactions(text)]


def _transactions(text: str) -> list[_Stated]:
    """Return what the numbers of transactions state, if none answers its own request."""
    found = [*_TRANSACTIONS.finditer(text)]
    pairs = [(int(words[1] or words[4]), int(words[2] or words[3])) for words in found]
    if pairs and all(asked - answer == 1 for answer, asked in pairs):
        return [_Stated.by(found[0], "each answer is that of the request before, so late by one")]
    if pairs and not any(asked == answer for answer, asked in pairs):
        answer, asked = pairs[0]
        other = "the answer to another request, of this client before or of another one behind the same gateway"
        return [_Stated.by(found[0], f"transaction {answer} answers, and {asked} was asked: {other}")]
    return []
