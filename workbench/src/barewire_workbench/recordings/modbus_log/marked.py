"""Logs of any program: a direction and bytes in a line, or a heading and the bytes below it.

**Decides for a whole log what its lines leave open: decimal or hexadecimal, the protocol, which side is the client**

Whole frames decide: those with a good CRC, a good LRC, or a header with the right length. What they do not prove stays
None, and the sniffer judges each frame by its shape.

**Lines with a direction in a word or a mark, and bytes after it: most programs write their traffic so**

    [2024-05-01 10:31:18] Send: 01 03 00 00 00 02 C4 0B            a program's own log
    Tx:000001-01 03 00 00 00 02 C4 0B                              Modbus Poll, Modbus Slave
    [RTU]>Tx > 14:32:05:052 - 64  03  00  01  00  01  DC  3F       QModMaster
    14.05.2025 09:57:07.113 'Device' Tx: 01 03 00 00 00 0A C5 CD   Modbus Tools
    05/01/2024 10:31:18.250 [TX] - 01 03 00 00 00 02 C4 0B         Docklight
    Request (transaction id 25): 00 19 00 00 00 06 01 03 00 01 00 0f      jamod
    TX: 1, 3, 0, 22, 0, 2, 37, 207                                 NModbus: decimal numbers
    > 01 03 00 00 00 02 C4 0B                                      a mark only
    → < 01 03 00 00 00 02 C4 0B >                                  modbus-cli
    Tx: 01 03 00 00 00 02 C4 0B Rx: 01 83 02 C0 F1                 an exchange on one line
    01 03 00 00 00 02 C4 0B -> 01 83 02 C0 F1

Words about the line (request, response, master, slave) state the direction on it. Words about the recording program
(sent, received, Tx, Rx) state its side; the whole log decides whether that is the client. A line that has only bytes
continues the line before it.

**Entries of several lines: a heading with a time or a direction, and below it the bytes, often as a dump**

    > 2024/05/11 13:17:34.000792034  length=8 from=0 to=7          socat -x, with -v also the characters
     01 03 00 00 00 02 c4 0b                          ........
    2006-05-30 13:23:49.461075: /dev/ttyS0                         jpnevulator --timing-print
    01 03 00 00 00 02 C4 0B                         ........
    2026/05/11 13:17:34.792 gsets22:4002 write 8                   EPICS asyn, traceIOHex
    [23/10/2008 10:38:33]                                          Serial Port Monitor (Eltima, HHD)
    3  IRP_MJ_WRITE - Request transfers data from a client to a COM port (COM5)
       01 03 00 00 00 02 C4 0B                                ........
    [D] Sent packet: @3FFB890C/6:                                  eModbus: what it sends on RTU, without its CRC
      | 0000: 01 03 00 00 00 02                         |......          |

Headings may have several lines, and have no bytes themselves. A heading without bytes below it is no entry.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from functools import lru_cache

from barewire import ascii, rtu, tcp
from barewire.errors import DecodeError
from barewire.modbus.messages.base import EXCEPTION_BIT
from barewire.modbus.messages.registry import decode_request, decode_response, measure_request, measure_response
from barewire.rtu.crc import crc16
from barewire_workbench.frames.result import ProtocolName, counted
from barewire_workbench.recordings.modbus_log.model import FormContent, LogEntry, LoggedBytes, Stamp
from barewire_workbench.recordings.modbus_log.octets import Octets, find_stamp, split_octets, without_stamp
from barewire_workbench.recordings.model import Unread
from barewire_workbench.sniffer import readable, shapes

_RARE = 4
"""One of so many pieces at least is a frame in a log of Modbus TCP."""
_MOST_BYTES = 260
"""A longer piece is not one frame."""
PROTOCOLS: tuple[ProtocolName, ...] = ("rtu", "tcp", "ascii")


def frame_pdu(protocol: ProtocolName, data: bytes) -> bytes | None:
    """Return the PDU if the bytes are exactly one frame of that protocol.

    >>> frame_pdu("rtu", bytes.fromhex("018302C0F1")), frame_pdu("tcp", bytes.fromhex("018302C0F1"))
    (b'\\x83\\x02', None)
    """
    try:
        if protocol == "rtu":
            return rtu.decode(data).pdu if len(data) <= _MOST_BYTES else None
        if protocol == "tcp":
            return tcp.decode(data).pdu
        return ascii.decode(data if data.endswith(b"\n") else data.rstrip(b"\r\n") + b"\r\n").pdu
    except DecodeError:
        return None


def frames_by_protocol(pieces: Iterable[bytes]) -> dict[ProtocolName, int]:
    """Return how many of the pieces are one whole frame, for each protocol."""
    counts: dict[ProtocolName, int] = dict.fromkeys(PROTOCOLS, 0)
    for data in pieces:
        for protocol in PROTOCOLS:
            pdu = frame_pdu(protocol, data)
            counts[protocol] += pdu is not None and (protocol != "tcp" or has_its_length(pdu))
    return counts


def has_its_length(pdu: bytes) -> bool:
    """Return whether a PDU has the length of its function. A header of TCP has no checksum: an RTU request of two
    registers from address 0 with a wrong CRC has one, 01 03 | 00 00 | 00 02."""
    if pdu[0] & EXCEPTION_BIT:
        return len(pdu) == 2
    sizes = measure_request(pdu), measure_response(pdu)
    return pdu[0] != 0 and (len(pdu) in sizes or sizes == (None, None))


def common_protocol(pieces: Sequence[bytes]) -> ProtocolName | None:
    """Return the protocol of the first frames: what a client asks in decides, whatever the answers are in. None if no
    piece is a frame."""
    counts = frames_by_protocol(pieces)
    # Some pieces look like a header of TCP by accident, and registers with text may be characters of ASCII.
    likely = [protocol for protocol in PROTOCOLS if counts[protocol] and _RARE * counts[protocol] >= len(pieces)]
    if not likely:
        return next((protocol for protocol in ("rtu", "ascii") if counts[protocol]), None)
    first = (protocol for data in pieces for protocol in likely if frames_by_protocol([data])[protocol])
    return next(first) if len(likely) > 1 else likely[0]


def is_decimal(entries: list[LogEntry]) -> bool:
    """Return whether the digits of the entries are decimal numbers and not hexadecimal ones.

    Raises DecodeError if they are frames in neither or in both.
    """
    as_decimal = [entry.decimal for entry in entries if entry.decimal is not None]
    as_hex = [entry.data for entry in entries if entry.data is not None]
    if len(as_hex) == len(entries) and len(as_decimal) < len(entries):
        return False
    if len(as_hex) < len(entries) and len(as_decimal) == len(entries):
        return True
    frames = [sum(frames_by_protocol(pieces).values()) for pieces in (as_hex, as_decimal)]
    if frames[0] == frames[1] and as_hex != as_decimal:
        line = next((entry.line for entry in entries if entry.decimal is not None), entries[0].line)
        text = f"line {line}: hexadecimal or decimal? no frame of the log decides it; write hexadecimal numbers with 0x"
        raise DecodeError("value", b"", 0, text)
    return frames[1] > frames[0]


def recorder_is_client(entries: Sequence[LogEntry], protocol: ProtocolName | None) -> bool | None:
    """Return whether the recording program is the client: it sent requests, or received responses. Requests and
    responses to a write are equal: of these alone, the first one is a request. None if no frame shows it."""
    votes, began = 0, None
    for entry in entries:
        pdu = None if entry.data is None or protocol is None else frame_pdu(protocol, entry.data)
        if entry.sent is None or not pdu:
            continue
        began = entry.sent if began is None else began
        request, response = shapes(pdu)
        if request != response:
            votes += 1 if request == entry.sent else -1
    return began if votes == 0 else votes > 0


def with_transactions(items: list[LoggedBytes | Unread], open_numbers: set[bytes]) -> list[LoggedBytes | Unread]:
    """Return the pieces of Modbus TCP with their direction: the first frame with a transaction number is a request,
    the next one its response, unless its shape tells. A piece of several frames becomes several. `open_numbers` are
    those of the requests without a response, before and after."""
    done: list[LoggedBytes | Unread] = []
    for item in items:
        if isinstance(item, Unread) or item.protocol != "tcp" or item.from_client is not None:
            if isinstance(item, LoggedBytes) and item.data:
                (open_numbers.add if item.from_client else open_numbers.discard)(item.data[:2])
            done.append(item)
            continue
        for data in _frames(item.data):
            pdu = frame_pdu("tcp", data)
            if pdu is None:
                done.append(item._replace(data=data))
                continue
            request, response = shapes(pdu)
            is_request = request if request != response else data[:2] not in open_numbers
            if is_request:
                open_numbers.add(data[:2])
            else:
                open_numbers.discard(data[:2])
            done.append(item._replace(data=data, from_client=is_request))
    return done


def _frames(data: bytes) -> list[bytes]:
    """Return the frames of a piece by the lengths in their headers."""
    frames: list[bytes] = []
    while len(data) >= 8 and data[2:4] == b"\x00\x00":
        size = 6 + int.from_bytes(data[4:6], "big")
        if len(data) > size and data[size + 2 : size + 4] != b"\0\0":
            break  # no header follows: the length is wrong
        frames.append(data[:size])
        data = data[size:]
    return [*frames, data] if data else frames


_WORD = re.compile(
    r"(?:(?<![A-Za-z])|(?-i:(?<=[a-z])(?=[A-Z])))(?:"
    r"(?P<asked>requests?|req|query|anfrage|requête|solicitud|richiesta|запрос|请求|請求)"
    r"|(?P<answered>responses?|resp|reply|answers?|antwort|réponse|respuesta|risposta|ответ|响应|應答|应答|回复)"
    r"|(?P<sent>IRP_MJ_WRITE|sends?|sent|sending|txd?|transmit|transmitted|transmitting|wrote|gesendet|отправлено|发送)"
    r"|(?P<received>IRP_MJ_READ|empfangen|получено|接收|收到|rec|recv|recd|rcv|rcvd|receives?|received|receiving|rxd?|got)"
    r"|(?P<asker>master|client)|(?P<answerer>slave|server)"
    r"|(?P<out>write|writes|writing|out|output)|(?P<into>read|reads|reading|in|input)"
    r")(?![A-Za-z])",
    re.IGNORECASE,
)
_MARK = re.compile(r"(?P<sent>-+>|>>+|=>|>|[→⇒])|(?P<received><-+|<<+|<=|<|[←⇐])")
_LAST_MARK = re.compile(rf"(?:^|[\s\])])(?:{_MARK.pattern})[\s:]*$")
_GROUPS = (("asked", "answered"), ("sent", "received"), ("asker", "answerer"), ("out", "into"))
"""Which words count if there are several: "response for read request" is a response, "server received" is received."""
_SIZE = re.compile(
    r"[\s:=>#\[\](\-]*(?:(?:\d+(?: ?bytes?)?|data|bytes?|buffer|frame|message)[\s:=>#\[\])\-]*){0,3}", re.IGNORECASE
)
"""What may stand between "read" or "write" and the bytes of a frame: their number."""
_LONGEST_SIZE = 60
_NAMED = re.compile(r"(?:[\s:=<>#\[\]()\d-]|to|master|client|slave|server)*", re.IGNORECASE)
"""What may stand between "master" or "slave" and the bytes of a frame."""
_NUMBER = re.compile(r"(?i)(?<![A-Za-z])(?:tx|rx):\d{4,8}-")
"""Modbus Poll counts its frames: the number belongs to the word, not to the bytes."""
_SINGLE = re.compile(r"(?:(?<![\w.])(?:0x|\\x)|[:=<>\]\[-]\s{0,9})([0-9A-Fa-f]{2})[\]>]?\s*$")
"""One byte alone: a part of a frame, as slow adapters deliver it. Without a mark it would be a number of bytes."""
_FEW = re.compile(
    r"""[\s\[<({'"]*(?P<digits>(?:(?:0[xX]|\\x)?[0-9A-Fa-f]{1,6}[\s,;:.|\-\]\[<>'"]{0,4}){1,3})"""
    r"""[\])}>]*(?: ?\(\d+\))?(?: at \d+|\|.*\|)?"""
)
_STRING = re.compile(r"\"([^\"\\]{1,260})\"\s*$")
_BITS = re.compile(r"[\s\[(]*[01](?:, ?[01])+[\s\])]*")
"""A list of values, each of one bit."""
_DIGITS = re.compile(r"[0-9A-Fa-f]+")
_OPENINGS_MAX, _MARKS_WORD, _BEHIND = 100, frozenset(":=>])}"), frozenset(":=>])}|-")
_OPENED = frozenset("[({<")
_LONG = "\0"
"""Before an opening behind which four bytes or more stand."""
_COMPLAINT = re.compile(r"(?i)\bCRC\b|checksum|invalid|incomplete|unexpected|discard|garbage|malformed|corrupt")
"""A program says so of what it received. Many print the bytes for a second time."""
_SEPARATORS = re.compile(r"[\s:=>#\[(<\])-]*")
_JOINT = re.compile(r"[\s,;|\[(]*(?:-+>|<-+|=+>|<=+|[→⇒←⇐/<>])?[\s,;:|\[(]*$")
"""What may stand between two frames of one line, apart from a word."""
_OFFSET = re.compile(r"[0-9A-Fa-f]{6,8}")
"""What stands before a colon in a line of a dump, and may be a frame by itself: 01B0 is the CRC of 0000."""
_SHORTEST = 4
"""Bytes of the shortest frame."""
_NOTHING = re.compile(r"['\"\])]*\s?[:=]\s*(?:b?''|b?\"\"|\[\])?\s*")


def read_marked(lines: list[str]) -> FormContent:
    """Return the entries of lines with a direction.

    >>> read_marked(["Tx:000001-01 03 00 00 00 02", " C4 0B", "Rx:000002-01 83 02 C0 F1"]).entries[0].data.hex(" ")
    '01 03 00 00 00 02 c4 0b'
    """
    entries: list[LogEntry] = []
    known: set[int] = set()
    openings: set[str] = set()  # what stands before bytes
    before = ""  # the last line with a direction
    open_line = 0  # the line that the next one may continue
    for number, line in enumerate(lines, start=1):
        if not line:
            continue
        marked = _marked(line, number, openings)
        if marked:
            if not (entries and _is_printed_twice(entries[-1], marked, before, line)):
                entries += (entry for entry in marked if entry.data is not None or entry.decimal is not None)
            before = line
            open_line = number
            known.add(number)
        elif open_line == number - 1 and entries and (more := split_octets(line)) and not more.before.strip():
            last = entries[-1]
            entries[-1] = last._replace(
                data=None if last.data is None or more.data is None else last.data + more.data,
                decimal=None if last.decimal is None or more.decimal is None else last.decimal + more.decimal,
            )
            open_line = number
            known.add(number)
    return FormContent(entries, known)


def _is_printed_twice(last: LogEntry, marked: list[LogEntry], before: str, line: str) -> bool:
    """Return whether the bytes of the last entry are printed again at the same time, by another part of the program."""
    entry = marked[0]
    said = entry.data, entry.decimal, entry.sent
    if len(marked) > 1 or not (entry.data or entry.decimal) or said != (last.data, last.decimal, last.sent):
        return False
    if _COMPLAINT.search(line) or _COMPLAINT.search(before):
        return True
    at_once = (
        entry.stamp is not None and last.stamp is not None and abs(entry.stamp.seconds - last.stamp.seconds) < 0.02
    )
    words = [_WORD.sub("", _DIGITS.sub("", text)) for text in (before, line)]
    return at_once and entry.sent is not None and words[0] != words[1]


def _marked(line: str, number: int, openings: set[str]) -> list[LogEntry]:
    """Return the entries of a line, one without bytes if the direction is all that it has; none for any other line."""
    plain, stamp = without_stamp(line)
    plain = _NUMBER.sub(lambda match: match[0][:2] + ":" + " " * (len(match[0]) - 3), plain)
    return [entry._replace(stamp=stamp) for entry in _directed(plain, number, openings)]


def _directed(plain: str, number: int, openings: set[str] | frozenset[str] = frozenset()) -> list[LogEntry]:
    """Return the entries of a line whose time is blank. Behind an opening of other bytes a few digits are bytes too."""
    octets = split_octets(plain)
    if isinstance(openings, set) and octets is not None and len(openings) < _OPENINGS_MAX:
        is_long = len(octets.data or b"") >= _SHORTEST
        openings.update((octets.before.strip(), *([_LONG + octets.before.strip()] if is_long else [])))
    if octets is None and openings:
        octets = _few(plain, openings) or _string(plain, openings)
    if octets is None and (single := _SINGLE.search(plain)) is not None:
        before = plain[: single.start(1)].removesuffix("0x").removesuffix("\\x")
        word, sent, from_client = direction_of(before)
        is_near = word is not None and (word.re is not _WORD or _SIZE.fullmatch(before[word.end() :]))
        if word is not None and word.re is not _COMPLAINT and is_near:
            return [LogEntry(number, bytes.fromhex(single[1]), sent, from_client)]
    if octets is not None and _BITS.fullmatch(plain, len(octets.before)):
        return []
    if octets is not None and (exchange := _exchange(octets, number)):
        return exchange
    before = plain if octets is None else octets.before
    word, sent, from_client = direction_of(before)
    if word is None:
        return []
    if octets is None:
        # "recv: " without bytes
        data = b"" if sent is False or from_client is False else None  # nothing came, or it is in the next lines
        return (
            [LogEntry(number, data, sent, from_client, None, data)]
            if _NOTHING.fullmatch(plain[word.end() :].strip())
            else []
        )
    size = len(octets.data or octets.decimal or b"")
    if word.re is _COMPLAINT and size < _SHORTEST:
        return []  # of a message: "failed! 8011!=FFFF"
    if word.re is _WORD and not any(frame_pdu(name, data) for name in PROTOCOLS for data in octets[1:] if data):
        nearest = _last_word(before) or word
        is_marked = before.rstrip()[-1:] in _BEHIND or plain[len(before) :].lstrip()[:1] in _OPENED
        is_behind = is_marked and _SIZE.fullmatch(before[nearest.end() :])
        if (size < _SHORTEST or octets.data is None) and not (is_behind or _LONG + before.strip() in openings):
            return []  # numbers of a sentence: "received a request for device 0x21. Registers: 0x1.", "read 10-20"
    return [LogEntry(number, octets.data, sent, from_client, None, octets.decimal)]


def _few(plain: str, openings: Iterable[str]) -> Octets | None:
    """Return the bytes of a line with one or a few of them, in any notation, which begins like lines with more."""
    text = plain.strip()
    words = [
        text[: word.end() + 1] for word in _WORD.finditer(text) if text[word.end() : word.end() + 1] in _MARKS_WORD
    ]
    words += [text[: mark.end()] for mark in _MARK.finditer(text)]
    before = max((opening for opening in [*openings, *words] if text.startswith(opening)), key=len, default="")
    match = _FEW.fullmatch(text[len(before) :])
    if not before or match is None:
        return None
    tokens = re.findall("[0-9A-Fa-f]+", re.sub(r"0[xX]|\\x", " ", match["digits"]))
    if len(tokens) == 1 and before not in openings:
        return None  # a number: "ReadRequest: 3"
    decimal = bytes(map(int, tokens)) if all(token.isdecimal() and int(token) < 256 for token in tokens) else None
    is_hex = all(len(token) < 3 or len(token) % 2 == 0 for token in tokens)
    data = bytes.fromhex("".join(token.rjust(2, "0") for token in tokens)) if is_hex else None
    return None if data is decimal is None else Octets(before, data, decimal)


def _string(plain: str, openings: Iterable[str]) -> Octets | None:
    """Return the bytes of a line that ends with a string without escapes, where other lines have some."""
    literal = _STRING.search(plain)
    if literal is None or plain[: literal.start()].strip() not in openings:
        return None
    return Octets(plain[: literal.start()], literal[1].encode("latin-1", "replace"))


def _exchange(last: Octets, number: int) -> list[LogEntry]:
    """Return the frames of a line with several of them, of which `last` is the last; none if it has only that one.

    A word before the last one states its direction. Otherwise it is the answer to the frame before it."""
    before, sent = last.before, None
    from_client: bool | None = False
    word = _last_word(before)
    if word is not None:
        _, sent, from_client = direction_of(word[0])
        before = before[: word.start()]
    joint = _JOINT.search(before) if len(before.strip()) >= 2 * _SHORTEST else None
    if joint is None or (word is None and not joint[0].strip()):
        return []
    before = before[: joint.start()]
    if joint[0].strip() == ":" and _OFFSET.fullmatch(before):
        return []
    octets = split_octets(before)
    if octets is None or len(octets.data or octets.decimal or b"") < _SHORTEST:
        return []
    entries = _directed(before, number)
    if entries and word is None:
        sent, from_client = _opposite(entries[-1].sent), _opposite(entries[-1].from_client)
    elif not entries:
        if not any(frame_pdu(name, data) for name in PROTOCOLS for data in octets[1:] if data):
            return []
        entries = [LogEntry(number, octets.data, _opposite(sent), _opposite(from_client), None, octets.decimal)]
    return [*entries, LogEntry(number, last.data, sent, from_client, None, last.decimal)]


@lru_cache(1024)
def _last_word(before: str) -> re.Match[str] | None:
    """Return the word about a direction with which a text ends; None if it ends otherwise."""
    words = list(_WORD.finditer(before))
    return words[-1] if words and _SEPARATORS.fullmatch(before[words[-1].end() :]) else None


def _opposite(direction: bool | None) -> bool | None:
    return None if direction is None else not direction


def has_direction(before: str) -> bool:
    """Return whether a word before some bytes states their direction."""
    return _WORD.search(before) is not None


@lru_cache(1024)
def direction_of(before: str) -> tuple[re.Match[str] | None, bool | None, bool | None]:
    """Return the word or mark that states the direction, whether the recorder sent, whether the client did."""
    words = list(_WORD.finditer(before))
    for yes, no in _GROUPS:
        matching = [word for word in words if word.lastgroup in (yes, no)]
        if not matching:
            continue
        word = matching[0]
        is_first = word.lastgroup == yes
        if yes == "asker" and not _NAMED.fullmatch(before[word.end() : word.end() + _LONGEST_SIZE]):
            continue  # the name of a program, as ModbusTcp.Client
        if yes in ("asked", "asker"):
            return word, None, is_first
        if yes == "out" and not _SIZE.fullmatch(before[word.end() : word.end() + _LONGEST_SIZE]):
            return None, None, None  # "read 2 registers: ..." are values, not a frame
        return word, is_first, None
    plain = before.strip("[]()\t :-|,;")
    mark = _MARK.match(plain) or _LAST_MARK.search(before)
    if mark is None:
        complaint = None if words else _COMPLAINT.search(before)
        return (None, None, None) if complaint is None else (complaint, False, None)
    return mark, mark.lastgroup == "sent", None


_BYTES = re.compile(
    r"\s*(?:\|\s*)?(?:(?:0x)?[0-9A-Fa-f]{4,8}(?::\s+|\s*\|\s*|\s{2,}))?"
    r"(?P<bytes>[0-9A-Fa-f]{2}(?:[ \t]{1,2}[0-9A-Fa-f]{2})*)(?:\s*$|\s*\t.{1,16}| {2,}.*|\s*\|.*)"
)
_BETWEEN = re.compile(r"(?:STATUS_\w+|-{2,}|Length:? \d+.*)?")
_EMODBUS_SENT = re.compile(r"(?:.*\W)?Sent packet: @[0-9A-Fa-f]{1,16}/(?P<count>\d{1,3}):\s*")
"""The title above bytes that eModbus passed to its serial line. It calculates the CRC while it sends."""
_HEADINGS = 4
"""The most lines of a heading."""
_SOCAT = re.compile(r"[<>] \d{4}/\d\d/\d\d \d\d:\d\d:\d\d\.(?P<fraction>\d{9})\s+length=")


def read_blocks(lines: list[str]) -> FormContent:
    """Return the entries that have a heading.

    >>> read_blocks(["> 2024/05/11 13:17:34.792  length=2 from=0 to=1", " 01 83"]).entries[0][1:3]
    (b'\\x01\\x83', True)
    """
    entries: list[LogEntry] = []
    known: set[int] = set()
    heading: list[int] = []
    fields: tuple[bool | None, bool | None, Stamp | None] = (None, None, None)
    in_bytes = False
    scale = _socat_scale(lines)
    for number, line in enumerate(lines, start=1):
        row = _BYTES.fullmatch(line)
        if row is not None and (heading or in_bytes):
            data = bytes.fromhex(row["bytes"].replace("\t", " "))
            if in_bytes and _begins_alike(entries[-1].data or b"", data):
                entries.append(entries[-1]._replace(line=number, data=data))
            elif in_bytes:
                entries[-1] = entries[-1]._replace(data=(entries[-1].data or b"") + data)
            else:
                sent, from_client, stamp = fields
                entries.append(LogEntry(number, data, sent, from_client, stamp))
                known.update(heading)
            known.add(number)
            heading, in_bytes = [], True
            continue
        if _BETWEEN.fullmatch(line.strip()):
            if line.strip() and in_bytes:
                known.add(number)
                in_bytes = False
            elif line.strip() and heading:
                heading.append(number)
            continue
        if in_bytes:
            fields = (None, None, None)
        in_bytes = False
        part = _heading(line)
        if part is None:
            heading, fields = [], (None, None, None)
            continue
        sent, from_client, stamp = part
        if scale != 1.0 and stamp is not None:
            stamp = stamp._replace(seconds=int(stamp.seconds) + stamp.seconds % 1 * scale)
        is_new = (sent is None and from_client is None) or (fields[0] is not None or fields[1] is not None)
        if is_new or len(heading) >= _HEADINGS:
            heading, fields = [], (None, None, None)
        fields = (
            fields[0] if sent is None else sent,
            fields[1] if from_client is None else from_client,
            stamp or fields[2],
        )
        heading.append(number)
    return _with_sent_crc(lines, FormContent(entries, known))


def _begins_alike(before: bytes, data: bytes) -> bool:
    """Return whether a line has an answer of its own, as long as the one above and with the same header: a dump has 8
    or 16 bytes in a line."""
    head = data[:_SHORTEST]
    return (
        len(data) == len(before) > _SHORTEST and len(data) % 8 > 0 and head == before[:_SHORTEST] and len({*head}) > 1
    )


def _with_sent_crc(lines: list[str], content: FormContent) -> FormContent:
    """Return the entries with the CRC that eModbus sends and does not print: behind a PDU of the right length."""
    entries: list[LogEntry] = []
    added: list[int] = []
    for entry in content.entries:
        data = entry.data or b""
        title = _EMODBUS_SENT.fullmatch(lines[entry.line - 2]) if entry.line > 1 else None
        if title is not None and int(title["count"]) == len(data) and is_without_crc(data):
            added.append(entry.line - 1)
            entry = entry._replace(data=with_crc(data))
        entries.append(entry)
    if not added:
        return content
    text = "Sent packet is printed without the CRC that eModbus sends; it is added to "
    return FormContent(entries, content.known, ((added[0], f"{text}{counted(len(added), 'frame')}"),))


def with_crc(data: bytes) -> bytes:
    """Return bytes with their CRC."""
    return data + crc16(data).to_bytes(2, "little")


def is_without_crc(data: bytes) -> bool:
    """Return whether the bytes are a unit and a PDU of RTU, and no more."""
    if len(data) < 3 or any(frame_pdu(protocol, data) is not None for protocol in ("rtu", "tcp")):
        return False
    pdu = data[1:]
    if pdu[0] & EXCEPTION_BIT:
        return len(pdu) == 2
    return any(readable(decode, pdu) is not None for decode in (decode_request, decode_response))


def _heading(line: str) -> tuple[bool | None, bool | None, Stamp | None] | None:
    """Return the direction and the time that a line states; None if it states neither."""
    stamp = find_stamp(line)
    plain = line if stamp is None else line[: stamp[1]] + " " * (stamp[2] - stamp[1]) + line[stamp[2] :]
    if split_octets(plain) is not None:
        return None  # an entry of one line, which a line of bytes may continue
    word, sent, from_client = direction_of(plain)
    if word is None and (stamp is None or line[: stamp[1]].strip("[( ")):
        return None
    if word is not None and stamp is None and not re.search(r":\s*$|IRP_MJ_|\b(?:read|write) \d+\s*$", line):
        return None
    return sent, from_client, None if stamp is None else stamp[0]


def _socat_scale(lines: list[str]) -> float:
    """Return 1000 if nine digits are microseconds: socat 1.7.4 pads these with zeros, so that all begin with 000."""
    fractions = [heading["fraction"] for line in lines if (heading := _SOCAT.match(line))]
    return 1000.0 if len(fractions) > 1 and all(fraction.startswith("000") for fraction in fractions) else 1.0
