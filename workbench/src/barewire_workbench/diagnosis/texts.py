"""What a text without bytes says: an error message of a program, a log that was not set to show the frames.

        "Modbus Error: [Input/Output] No Response received"  -->  no-bytes: no answer in time; how pymodbus logs bytes

Such a text proves nothing about a line or bus, so that the one verdict is `no-bytes`. It says what the words state (the
port is closed, a device refused, no answer came) and how the program that wrote them is told to log its bytes.
"""

from __future__ import annotations

import re
from itertools import chain

from barewire.canopen.abort_codes import abort_text
from barewire.modbus.exceptions import exception_name
from barewire_workbench.diagnosis.verdict import LineVerdict
from barewire_workbench.recordings.modbus_log import LoggedBytes, ModbusLog

_GENERAL_FORMS = ("marked", "blocks", "bytes")
"""Forms that any program may have written: a word and hexadecimal digits are enough."""
_SHORTEST = 4
"""Bytes of the shortest frame."""
_CANDUMP = "candump -L can0 > bus.log, and ip -details -statistics link show can0"
_PROGRAMS: tuple[tuple[str, str, str], ...] = (
    (
        "Home Assistant",
        r"homeassistant|custom_components|SyncWorker_\d",
        "in configuration.yaml the lines `logger:`, `  logs:`, `    pymodbus: debug`",
    ),
    (
        "Node-RED",
        r"contribModbus|node-red|modbus-getter|modbus-client|\bFSM \w+",
        "DEBUG=contribModbus*,modbus-serial node-red -v",
    ),
    ("evcc", r"\bevcc\b|\[site *\]|\[lp-\d", "evcc --log trace"),
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
        r"canopen\.|canopen[/\\]|Sdo(?:Aborted|Communication)Error|boot-up message|statusword|trying to change state",
        _CANDUMP,
    ),
    (
        "a program on CAN",
        r"socketcan|\bcan\d\b|CanError|CanOperationError|No buffer space|canopen::|canopen_|[Aa]bort code|"
        r"SDO|Transition timeout",
        _CANDUMP,
    ),
)
"""Programs by the words of their messages, and how each is told to show its bytes. The first that fits counts: those
that use the library of another come before it."""
_ANY_PROGRAM = "of TCP by tcpdump -i any -w line.pcap port 502, of a serial line by barewire sniff at a second adapter"

_STATED: tuple[tuple[str, str], ...] = (
    (
        r"refused|ECONNREFUSED|Errno 111",
        "the connection is refused: nothing listens on the port, or no further client is taken",
    ),
    (r"unreachable|No route to host|EHOSTUNREACH", "the host is not reached"),
    (r"Errno -[235]\]|getaddrinfo|Name or service", "the name of the host is not known"),
    (
        r"unexpectedly closed|reset by peer|ECONNRESET|IncompleteReadError|[Cc]onnection (?:lost|closed)",
        "the other side closed the connection",
    ),
    (
        r"Failed to connect|connect failed|dial tcp .*timeout|failed: timed out|FSM|Port Not Open|could not open",
        "there is no connection",
    ),
    (r"CRC|[Cc]hecksum", "a checksum was wrong"),
    (
        r"[Ll]ength error|data size|WRONG_BYTES|[Ll]ength is invalid|not corresponding|count does not match",
        "an answer had another length",
    ),
    (r"[Uu]nable to decode", "an answer was not understood"),
    (
        r"slave id '?\d+'? does not match|ask for id=|was expected but slave|not from requested slave|Wrong slave",
        "an answer came from another unit",
    ),
    (r"No buffer space|CANsend\) Transmitting", "frames cannot be sent: no other node acknowledges, or the bus is off"),
    (
        r"(?i)no (?:sdo )?response|no answer|time[ds]?[- ]?out|ETIMEDOUT|not receive a response|no communication|"
        r"offline|waiting for",
        "no answer came in time",
    ),
)
"""What the words of a message state, most telling first."""
_FAILS = re.compile(
    r"(?i)error|fail|exception|time[- ]?d?[- ]?out|result|refused|no response|abort|\berr\b|offline|duplicate|reset|"
    r"no buffer"
)
_BYTES = re.compile(r"(?i)\b[0-9a-f]{2}([ ,:.-])(?:[0-9a-f]{2}\1){3}[0-9a-f]{2}\b")
"""Five bytes with one separator; dates, times and addresses of hosts have fewer."""
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
    "gatewaynoresponse": 11,
}
_NAME = re.compile(
    r"(?i)illegal[ _]?(?:function|(?:data[ _]?)?(?:address|value))|(?:slave|device)[ _]?(?:failure|busy)|"
    r"gateway[ _]?no[ _]?response"
)
_EXCEPTION = re.compile(r"Exception Response\(|exceptionCode|SlaveException")
_ABORT = re.compile(r"\b0x(0[568][0-9A-Fa-f]{6})\b")
_TRANSACTIONS = re.compile(
    r"transaction[ _]id '?(\d+)'? does not match request '?(\d+)|ask for transaction_id=(\d+) but got id=(\d+)"
)


def verdict_without_bytes(text: str) -> LineVerdict | None:
    """Return the verdict on a text that holds no bytes; None if it is no message of a failure.

    >>> verdict_without_bytes("Modbus Error: [Input/Output] No Response received from the remote unit").code
    'no-bytes'
    """
    if _FAILS.search(text) is None or _BYTES.search(text):
        return None
    program, how = next(
        ((name, how) for name, words, how in _PROGRAMS if re.search(words, text, re.MULTILINE)), ("", _ANY_PROGRAM)
    )
    stated = list(dict.fromkeys(chain(_numbered(text), (what for words, what in _STATED if re.search(words, text)))))
    said = f"the text says that {', that '.join(stated)}" if stated else "the text does not say what failed"
    log = f"a log of {program} with its bytes: {how}" if program else f"a log with bytes: {how}"
    return LineVerdict("no-bytes", "there are no bytes, so that no cause is proved", f"{said}; to get {log}")


def is_text(log: ModbusLog) -> bool:
    """Return whether the bytes that were read from words are too few for a frame: digits of a message.

    >>> from barewire_workbench.recordings.modbus_log import read_modbus_log
    >>> is_text(read_modbus_log(b"0x03 (RES) Exception (2): Illegal Data Address"))
    True
    """
    pieces = [len(item.data) for item in log.items if isinstance(item, LoggedBytes)]
    return log.form in _GENERAL_FORMS and max(pieces, default=0) < _SHORTEST and sum(pieces) < _SHORTEST * 2


def _numbered(text: str) -> list[str]:
    """Return what the numbers in a message state: exceptions, abort codes, transactions."""
    stated = []
    numbers = {int(number, 0) for number in _NUMBER.findall(text) if number.startswith("0x") or number.isdecimal()}
    numbers |= {_NAMES[re.sub(r"[ _]", "", name).lower()] for name in _NAME.findall(text)}
    for number in sorted(numbers & set(range(1, 12))):
        stated.append(f"a device is reached and refuses: exception {number:02X} ({exception_name(number)})")
    if not stated and _EXCEPTION.search(text):
        stated.append("a device is reached and refuses with an exception")
    stated += [f"a node refuses: abort {code.upper()} ({abort_text(int(code, 16))})" for code in _ABORT.findall(text)]
    pairs = [(answer or got, request or asked) for answer, request, asked, got in _TRANSACTIONS.findall(text)]
    if pairs and all(int(request) - int(answer) == 1 for answer, request in pairs):
        stated.append("each answer is that of the request before, so late by one")
    return stated
