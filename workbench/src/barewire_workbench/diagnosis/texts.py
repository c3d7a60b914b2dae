"""What a text without bytes says: an error message of a program, a log that was not set to show the frames.

        "Modbus Error: [Input/Output] No Response received"  -->  no-bytes: no answer in time; how pymodbus logs bytes

Such a text proves nothing about a line or bus, so that the one verdict is `no-bytes`. It shows the messages of programs
that are known, what they mean (the port is closed, no answer came), and how that program is told to log its bytes.
Causes are not guessed. What a person writes, settings, titles, questions and code are no messages (`_messages`).
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator
from itertools import chain
from typing import NamedTuple

from barewire.canopen.abort_codes import AbortCode, abort_text
from barewire.canopen.emcy import error_text, register_names
from barewire.modbus.exceptions import exception_name
from barewire_workbench.diagnosis.exchange import shown_digits
from barewire_workbench.diagnosis.fragments import floats_of, pieces_of, readings_of
from barewire_workbench.diagnosis.verdict import LineVerdict
from barewire_workbench.recordings.modbus_log import LoggedBytes, ModbusLog
from barewire_workbench.recordings.modbus_log.posted import PROSE

_SHOWN = 8
"""Pieces of bytes that a verdict shows."""
_NO_FRAMES = "no frame is read in this text, so that no cause is proved"
NO_WHOLE_FRAMES = "no whole frame is read in this text, so that no cause is proved"
"""What the verdict says of data, or of a few bytes in a sentence."""
_ONLY_SAID = "the messages beside the bytes are said, not seen"
_LONG = 14
"""Characters of a text that is no word of every message."""
_REFUSAL, _LONGEST_ANSWER, _MOST_REGISTERS = 5, 255, 125
"""Bytes of an exception and of the longest answer on a serial line, and the registers in that."""
_UNDECIDED = frozenset({"nothing-wrong", "open", "not-seen", "nothing-heard", "no-frames", "refused"})
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
        r"contribModbus|node-red|modbus-getter|modbus-client:|\bFSM \w+",
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
        r"\bcan[-_ ]?bus|slcan|berr-counter|mcp[-_]?2515|\btwai\b|flexcan|fdcan|bxcan|"
        r"stuff(?:ing)? error|(?-i:\bCAN\b)|\b(?:11|29)[- ]?bit\b",
        _CANDUMP,
    ),
)
"""Programs by the words of their messages, and how each is told to show its bytes. The first that fits counts: those
that use the library of another come before it."""
_ANY_PROGRAM = "of TCP by tcpdump -i any -w line.pcap port 502, of a serial line by barewire sniff at a second adapter"

_SILENT, _CHECKSUM = "no answer came in time", "a checksum did not fit"
_TIME_OUT = "a time-out: what the program waited for did not come in time"
_LENGTH = "an answer had another length than the program expected"
_OTHER_UNIT = "an answer came from another unit than the program asked"
_NO_CONNECTION = "the TCP connection is not made"
_EQUAL = "the checksum received and the one calculated are equal"
_STATED: tuple[tuple[str, str], ...] = (
    (r"(?i)connection refused|ECONNREFUSED|Errno 111", "the TCP connection is refused"),
    (r"(?i)(?:network|host) is unreachable|no route to host|EHOSTUNREACH", "the host is not reached"),
    (
        r"(?i)could not open port|port (?:is )?not open|port is closed|PortNotOpen",
        "the port cannot be opened, or is not open",
    ),
    (r"(?i)permission denied|access is denied|\bEACCES", "the operating system denies the access"),
    (r"(?i)(?:resource|port|device) (?:is )?busy|\bEBUSY", "the port or device is in use"),
    (r"(?i)network is down|ENETDOWN", "the interface is not up"),
    (
        r"(?i)acknowledge?(?:ment)?[- ]error|\bno-acknowledge|\back[- _]err",
        "a frame was sent, and no other node acknowledged it",
    ),
    (r"(?i)all ?tx ?busy", "all transmit buffers of the CAN controller are full"),
    (
        r"(?i)\bstuff(?:ing)?[- _]err\w*|\b(?:form|frame-format)[- _]err\w*",
        "a frame broke the rules of bit stuffing or form",
    ),
    (r"(?i)\bbit[01]?[- _]err\w*", "the controller read another bit than it sent"),
    (
        r"(?i)\(bit, stuff, crc, form, ack\) error|\bbus[- _]error count: [1-9]|"
        r"\bberr-counter tx (?:[1-9]\d*|0 rx [1-9]\d*)",
        "the CAN controller counts errors in frames: no acknowledge, stuffing, form, a bit, or the CRC",
    ),
    (r"Unexpected response 0x80\b", "an SDO abort came where a confirmation was due"),
    (r"(?i)no buffer space|ENOBUFS|\bErr(?:no|or Code) 105\b", "the send queue of the interface is full"),
    (r"(?i)\bbus[- _]off\b", "the CAN controller has left the bus, since its error counter passed its limit"),
    (r"\bstate ERROR-ACTIVE\b", "the CAN controller is error active: its error counters are low"),
    (r"(?i)\berror[- _]passive\b", "the CAN controller is error passive: an error counter of it is above 127"),
    (r"Unexpected response from modbus device", "a device answers with a value that the program is not set up for"),
    (r"Errno -[235]\]|getaddrinfo|Name or service", "the name of the host is not known"),
    (r"(?i)reset by peer|ECONNRESET", "the other side reset the TCP connection"),
    (r"(?i)unexpectedly closed|: EOF\b|IncompleteReadError|connection (?:lost|closed)", "the connection ended"),
    (r"(?i)failed to connect|connect failed|connect ETIMEDOUT|dial tcp .*timeout|failed: timed out", _NO_CONNECTION),
    (
        r"(?i)\b(?:crc|lrc|checksum)(?: check)?\W{0,2} ?(?:error|fail\w*|mismatch)|"
        r"\b(?:invalid|wrong|bad) (?:crc|checksum)|frame check (?:failed|error)|CRC received \w+ != |_CRC\b",
        _CHECKSUM,
    ),
    (
        r"(?i)length error|WRONG_BYTES|unexpected byte count|(?:response|data) length is invalid|count does not match",
        _LENGTH,
    ),
    (r"[Uu]nable to decode", "an answer was not understood"),
    (
        r"(?i)(?:slave|unit|device) id '?\d+'? does not match|was expected but slave|not from requested slave",
        _OTHER_UNIT,
    ),
    (
        r"(?i)\b(?:uart|rx) (?:parity|framing|frame) err\w*|\b(?:rx|uart) break\b",
        "the UART reports an error of parity or framing, or a break",
    ),
    (r"(?i)\bR?PDO[-_ ]?time[-_ ]?out", "a PDO did not come in the time that its consumer is set to"),
    (r"ctx->slave != -1", "libmodbus has no unit to ask: it refuses those above 247 itself, and nothing was sent"),
    (r"Cleanup recv buffer before send", "bytes were in the buffer when the next request was sent"),
    (r"\bdropped [1-9]\d* bytes\b", "the program discards bytes that it received"),
    (
        r"(?i)\bstate bus-off\b[^\n]{0,60}\brestart-ms 0\b",
        "after bus off the interface does not start again by itself",
    ),
    (r"NOT REQUESTED transaction", "an answer has a transaction number that no waiting request has"),
    (r"(?i)received (\w+)\W+calculated \1\b", _EQUAL),
    (
        r"(?i)no (?:\w+ ){0,2}(?:response|answer|reply)|no communication with|"
        r"\b(?:did|does) not (?:respond|receive (?:a |any )?response)",
        _SILENT,
    ),
    (
        r"(?i)(?<![\w.])(?<!\bthe )(?<!\bno )(?<!PDO )(?<!enable )timed?[-_ ]?out(?:error)?\b"
        r"(?!\W{0,2}[=:(]\W*\d| ?(?:setting|of |to |\d)| (?:\w+ )?not\b)|ETIMEDOUT|"
        r"_TIMEOUT\b|TransactionTimedOut",
        _TIME_OUT,
    ),
)
"""What words mean in a message of a program, most telling first. A meaning is what the message says and no more: why it
was written is open."""
_PERSON = re.compile(
    r"(?i)\b(?:I|I['’]?m|my|we|our|your?|if|should|would|could(?! not)|maybe|because|how|why|who|sometimes|always|"
    r"never|they|he|it|it['’]?s|wants?|works?|formerly)\b|\?\s*$"
)
"""Words that people write, and programs hardly ever."""
_NO_MESSAGE = re.compile(
    r"^\s*(?:#{1,6} |at |File \"|//|#include|#define|"
    r"(?:def|class|import|return|else|public|void|int|const|var|let|elif|except|raise|throw)\b|"
    r"(?:if|for|while)\b.*[:({]\s*$|(?:if|for|while)\s*\()|"
    r"[{;]\s*$|^\s*[})\]]+|^\s*[\w.\]\[]+ ?=(?!=)|^\s*[\w.]+\(.*\)\s*(?:#.*|//.*)?$|"
    r"^\s*\"?[\w-]+\"?\s*[:=]\s*[\d.]+,?\s*$|\btransaction state from\b|\bWAITING[ _]FOR[ _]REPLY\b"
)
"""Lines that are titles, frames of a stack, code, settings, or the usual states of a program."""
_CODE_BELOW = re.compile(r"\s*File \".*, line \d+, in ")
"""A frame of a traceback of Python, below which its line of code stands."""
_LOGGED = re.compile(r"\b(?:ERROR|WARN(?:ING)?|INFO|DEBUG|TRACE)\b|\[[CDVWE]\]\[|^[EWI] \(\d+\)|\d:\d\d:\d\d[.,]\d")
"""A line of a log."""
_QUOTED = re.compile(
    r"`[^`\n]{4,400}`|\"[^\"\n]{4,400}\"|“[^”\n]{4,400}”|"
    r"(?i:\b(?:error|exception|message|says|warning)\b[^:\n]{0,30}: ).*"
)
"""What a person quotes, or writes behind a word for a message."""
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
    r"(?i)n['’]?t\b|\bcannot\b|\bnever\b|\bstops?\b|\balways\b|\bproblem|\btrouble|\bstuck\b|\bhangs?\b|\bcorrect|\?"
)
"""Words of people on a line or bus, and on a failure: a text with one of each is a message too."""
_IS_DEBUG = re.compile(r"\b(?:DEBUG|TRACE)\b|\b[DV] \(\d+\) |\[(?:VV?|D)\]")
_TROUBLE = re.compile(
    r"(?i)\b(?:errors?|crash\w*|fail\w*|problems?|issues?|bugs?|wrong|incorrect\w*|invalid|broken|corrupt\w*|garbage|"
    r"unavailable|unexpected|unable|stuck|hang(?:s|ing)?|freez\w+|drops?|lost|los(?:es?|ing)|missing|missed|"
    r"disconnect\w*|stop(?:s|ped)|time[sd]?[- ]?outs?|exceptions?|no (?:\w+ )?(?:response|reply|answer|data|values?)|"
    r"cannot|(?:ca|do|does|did|is|was|could|wo)n['’]?t|(?:do|does|did|is|was|could) not|never|"
    r"fehler\w*|probleme?|falsche?\w*|nicht|keine?\w?)\b"
)
"""What a person says of trouble, in a title too."""
_NUMBER = re.compile(r"(?i)exception[ _]?(?:code)?[\"']?\s*[:=]?\s*[('\"]*(0x[0-9a-f]{1,2}|\d{1,2})\b(?!\d)(?!,)")
_EXCEPTIONS = (
    (1, "illegalfunction"),
    (2, "illegaladdress illegaldataaddress"),
    (3, "illegalvalue illegaldatavalue"),
    (4, "slavefailure devicefailure serverfailure"),
    (6, "slavebusy devicebusy serverbusy"),
    (8, "memoryparityerror"),
    (10, "gatewaypathunavailable gatewaypathsunavailable"),
    (11, "gatewaynoresponse targetdevicefailedtorespond"),
)
_NAMES = {name: number for number, names in _EXCEPTIONS for name in names.split()}
_NAME = re.compile(
    r"(?i)illegal[ _]?(?:function|(?:data[ _]?)?(?:address|value))|(?:slave|server|device)[ _]?(?:failure|busy)|"
    r"gateway[ _]?(?:no[ _]?response|paths?[ _]?unavailable)|memory[ _]?parity[ _]?error|"
    r"target[ _]?device[ _]?failed[ _]?to[ _]?respond"
)
_ABORT = re.compile(r"\b(?:0x|(?<=\())(0[568][0-9A-Fa-f]{6})\b")
_ABORT_TEXTS = {code.text.partition(",")[0].lower(): code for code in AbortCode if len(code.text) > _LONG}
_EMERGENCY = re.compile(r"(?i)\b(?:emcy|emergency)\b.{0,80}?\b(?:0x)?([0-9a-f]{4})h?\b")
_UNIT = re.compile(r"(?i)(?:(?:slave|unit|server)(?: address| id)? out of range \(|-- Polling slave )(\d{3,})\b")
_SAID = r"\b(?:0x[0-9a-f]{1,8}|\d[0-9a-f]{0,7}|[a-f][0-9a-f]{0,6}\d[0-9a-f]{0,6})\b"
_WANTED = (
    rf"\b(?:expect\w*|should (?:be|have)|instead of|ask(?:ed)?(?: for)?|calculated|computed|count)\b"
    rf"[^\d\n]{{0,24}}?({_SAID})"
)
_CAME = rf"\b(?:got|received|actual(?:ly)?|found|returned|was|but)\b[^\d\n]{{0,24}}?({_SAID})"
_MISMATCH = re.compile(rf"(?i){_WANTED}[^\d\n]{{0,24}}?{_CAME}|{_CAME}[^\d\n]{{0,24}}?{_WANTED}")
"""Two numbers of which a message says that one was expected, and the other came: `expected 7 bytes, got 5`."""
_OF_MISMATCH = (
    (re.compile(r"(?i)\bcrc|\blrc|checksum"), _CHECKSUM),
    (re.compile(r"(?i)function"), "an answer has another function than the program asked"),
    (re.compile(r"(?i)byte|length|\bsize|short|\blong\b|count|registers"), _LENGTH),
    (re.compile(r"(?i)slave|\bunit|device|dev_id|\bid\b"), _OTHER_UNIT),
)
"""Words of what differs, and what it means."""
_BEFORE = 40
"""Characters before two numbers in which the word stands."""
_ERROR_REGISTER = re.compile(r"\b(\d{1,3}) r(?:ead)? 0x1001 (?:0x)?0\b[^\n]*\n\s*\[\d+\] (?:0x)?([0-9A-Fa-f]{2})\b")
_QUEUE = re.compile(r"\bqlen (\d+)\b")
_LAST_UNIT = 247
_NO_VALUE = re.compile(
    r"(?i)(?:\[|=|\b(?:values?|reads?|returns?|shows?|got|get|gives?|is|always)\b:?) ?(65535|32767|-?32768)\b(?![.,]\d)"
)
"""A value that the text gives, and not a limit or a port."""
_ERROR_CODES = re.compile(r"errorCode\W{1,4}(?P<function>\d{3})\W{1,4}exceptionCode\W{1,4}(?P<code>\d{1,3})\b")
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
    """Return the known words of a text with their meaning."""
    if not stated:
        return "no message that is known here"
    return "; ".join(f'"{words}" (line {line}): {what}' for what, words, line in stated)


def verdict_without_bytes(text: str) -> LineVerdict | None:
    """Return the verdict on a text that holds no bytes; None if it is no message.

    >>> verdict_without_bytes("Modbus Error: [Input/Output] No Response received from the remote unit").code
    'no-bytes'
    """
    is_message = _IS_MESSAGE.search(text) or (_FIELD.search(text) and _FAILURE.search(text))
    pieces = pieces_of(text)
    readings = readings_of(text, pieces)
    is_prose = 0 < max(map(len, pieces), default=0) < _REQUEST and PROSE.search(text) is not None
    if "\0" in text or not (is_message or readings or is_prose):
        return None
    stated = _stated(text)
    said = _said(stated)
    if readings:
        return LineVerdict("not-seen", NO_WHOLE_FRAMES, "; ".join([*readings[:_SHOWN], *([said] if stated else [])]))
    if pieces:
        return LineVerdict(
            "not-seen", NO_WHOLE_FRAMES, f"{', '.join(map(shown_digits, pieces[:_SHOWN]))}; {said}{_more(text, stated)}"
        )
    first, second = (said, _NO_FRAMES) if stated else (_NO_FRAMES, said)  # the words that the reader knows come first
    return LineVerdict("no-bytes", first, second + _more(text, stated))


def _more(text: str, stated: Collection[_Stated]) -> str:
    """Return how to get the bytes that would tell more; empty if the text shows that they are recorded already."""
    program, how = _program(text, stated)
    if how in text or (how == _CANDUMP and "candump" in text):
        return ""
    if how == _CANDUMP and "berr-counter" in text:
        how = _CANDUMP.partition(",")[0]  # the other command is there
    log = f"a log of {program}" if program else "a log"
    return f"; the bytes of an exchange that fails would tell more, in {log}: {how}"


def verdict_of_words(text: str, codes: Collection[str]) -> LineVerdict | None:
    """Return what the words beside the bytes state, as said and not seen; None if they state nothing, or if `codes`,
    those of the diagnosis, name a cause."""
    if "\0" in text or set(codes) - _UNDECIDED:
        return None
    stated = _stated(text)
    if "nothing-wrong" in codes or "refused" in codes:
        stated = [known for known in stated if known.what not in (_SILENT, _TIME_OUT)]  # the bytes show it
    floats = [] if "canopen" in text.lower() else list(floats_of(text, pieces_of(text)))[:_SHOWN]
    if floats:
        return LineVerdict("said", _ONLY_SAID, "; ".join(floats))
    if not stated:
        return None
    is_fitting = any(known.what == _CHECKSUM for known in stated) and set(codes) <= {"nothing-wrong", "open", "refused"}
    fits = "; the checksums of the frames read here fit" if is_fitting else ""
    return LineVerdict("said", _ONLY_SAID, _said(stated) + fits)


def limited_to_the_frames(verdict: LineVerdict, lines: Iterable[str], words: LineVerdict | None) -> LineVerdict:
    """Return a verdict that all is good as one on the frames alone, if the text around them tells of trouble: a title,
    or `words`, the verdict on its messages.

    >>> limited_to_the_frames(LineVerdict("nothing-wrong", "nothing wrong", "2 frames"), ["Error reading"], None).code
    'not-seen'
    """
    is_told = words is not None or any(_TROUBLE.search(line) and not _LOGGED.search(line) for line in lines)
    if verdict.code != "nothing-wrong" or not is_told:
        return verdict
    return LineVerdict("not-seen", "the frames shown are sound, and the text tells of more", verdict.evidence)


def _messages(text: str) -> str:
    """Return a text with blanks in place of all that is no message of a program: of what a person writes, only what is
    quoted remains.

    >>> _messages('If it fails it says "no response" here')
    '                    "no response"     '
    """
    lines, is_code = [], False
    for line in text.split("\n"):
        kept = line
        if is_code or _NO_MESSAGE.search(line):
            kept = " " * len(line)
        elif _PERSON.search(line) and not _LOGGED.search(line):
            kept = " " * len(line)
            for quoted in _QUOTED.finditer(line):
                if " " in quoted[0] and not _PERSON.search(quoted[0]):
                    kept = kept[: quoted.start()] + quoted[0] + kept[quoted.end() :]
        is_code = _CODE_BELOW.match(line) is not None
        lines.append(kept)
    return "\n".join(lines)


def _stated(text: str) -> list[_Stated]:
    """Return what the words of a text mean in messages of programs, each meaning once, with the first words of it."""
    text = _messages(text)
    found = ((re.search(words, text), what) for words, what in _STATED)
    known = [*_numbered(text), *(_Stated.by(words, what) for words, what in found if words)]
    by_meaning = {stated.what.partition(": ")[0]: stated for stated in reversed(known)}
    if _SILENT in by_meaning or _NO_CONNECTION in by_meaning:
        by_meaning.pop(_TIME_OUT.partition(": ")[0], None)
    return [*reversed(by_meaning.values())]


def _program(text: str, stated: Collection[_Stated]) -> tuple[str, str]:
    """Return the program that wrote a text, and how it logs its bytes; an empty name if no word tells."""
    program = next(((name, how) for name, words, how in _PROGRAMS if re.search(words, text, re.MULTILINE)), None)
    if program is not None and program[1] != _CANDUMP and _IS_DEBUG.search(text):
        return program[0], f"{program[1]}; if that is set already, {_ANY_PROGRAM}"
    if program is not None:
        return program
    is_can = any(known.what.startswith(("SDO ", "emergency ")) for known in stated)
    return ("a program on CAN", _CANDUMP) if is_can else ("", _ANY_PROGRAM)


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
            who = "a gateway answers for the device" if number in (10, 11) else "a device answers, and refuses"
            stated.append(_Stated.by(words, f"exception {number:02X} ({exception_name(number)}) of Modbus: {who}"))
    for words in _ERROR_CODES.finditer(text):
        function, code = int(words["function"]) & 0x7F, int(words["code"])
        if code not in range(1, 12):
            own = "a code of the device or gateway itself: the standard has 01 to 0B"
            stated.append(_Stated.by(words, f"exception {code:02X}h to function {function:02X}, {own}"))
    aborts = {int(words[1], 16): words for words in _ABORT.finditer(text)}
    if not aborts and "bort" in text:
        named = ((code, re.search(f"(?i){re.escape(name)}", text)) for name, code in _ABORT_TEXTS.items())
        aborts = {int(code): words for code, words in named if words}
    for code, words in sorted(aborts.items()):
        stated.append(_Stated.by(words, f"SDO abort {code:08X} ({abort_text(code)})"))
    for words in _EMERGENCY.finditer(text):
        stated.append(_Stated.by(words, f"emergency {words[1]}h ({error_text(int(words[1], 16))})"))
    for words in _UNIT.finditer(text):
        if int(words[1]) > _LAST_UNIT:
            other = "a register?" if int(words[1]) > _LONGEST_ANSWER else "248 to 255 are reserved"
            stated.append(_Stated.by(words, f"unit {words[1]} is asked, which is none: 1 to 247 are; {other}"))
    for words in _QUEUE.finditer(text):
        stated.append(_Stated.by(words, f"the send queue of the interface holds {words[1]} frames"))
    for words in _NO_VALUE.finditer(text):
        marks = f"{int(words[1]) & 0xFFFF:04X}h, which many devices send for a value that they do not have"
        stated.append(_Stated.by(words, f"{words[1]} is {marks}"))
    return [*stated, *_mismatches(text), *_registers(text), *_transactions(text)]


def _mismatches(text: str) -> Iterator[_Stated]:
    """Yield what the numbers state of which one was expected and another came."""
    for words in _MISMATCH.finditer(text):
        before = text[max(0, words.start() - _BEFORE) : words.start()].rpartition("\n")[2]
        wanted, came = filter(None, words.group(1, 2) if words[1] else words.group(4, 3))
        what = next((what for noun, what in _OF_MISMATCH if noun.search(before + words[0])), None)
        if wanted == came or what is None or "transaction" in before + words[0]:
            continue
        expected = int(wanted) if what == _LENGTH and wanted.isdecimal() else 0
        is_refusal = came == str(_REFUSAL) and expected > _REFUSAL
        if is_refusal:
            yield _Stated.by(words, f"5 bytes came where {expected} were expected: the length of a refusal")
        if expected > _LONGEST_ANSWER:
            asked = (expected - _REFUSAL) // 2
            yield _Stated.by(words, f"{asked} registers are asked, and {_MOST_REGISTERS} are the most")
        if not is_refusal:
            yield _Stated.by(words, f"{what}: {came}, not {wanted}")


def _registers(text: str) -> Iterator[_Stated]:
    """Yield what an ASCII gateway of CANopen (CiA 309-3) returned of the error register of a node, 1001h."""
    read: dict[str, list[re.Match[str]]] = {}
    for words in _ERROR_REGISTER.finditer(text):
        read.setdefault(words[1], []).append(words)
    for node, found in read.items():
        values = [int(words[2], 16) for words in found]
        marks = [1 << bit for bit in range(8) if any(value >> bit & 1 for value in values)]
        bits = [f"{mark:02X}h is {name} error" for mark in marks for name in register_names(mark)]
        shown = "; ".join([", ".join(f"{value:02X}h" for value in values), *bits])
        yield _Stated.by(found[0], f"the error register 1001h of node {node} is read as {shown}")


def _transactions(text: str) -> list[_Stated]:
    """Return what the numbers of transactions state, if none answers its own request."""
    found = [*_TRANSACTIONS.finditer(text)]
    pairs = [(int(words[1] or words[4]), int(words[2] or words[3])) for words in found]
    if pairs and all(asked - answer == 1 for answer, asked in pairs):
        return [_Stated.by(found[0], "each answer has the number of the request before, so late by one")]
    if pairs and not any(asked == answer for answer, asked in pairs):
        answer, asked = pairs[0]
        return [_Stated.by(found[0], f"transaction {answer} answers, and {asked} was asked")]
    return []
