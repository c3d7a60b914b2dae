"""Lines with a direction in a word or a mark, and bytes after it: most programs write their traffic so.

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
"""

from __future__ import annotations

import re
from functools import lru_cache

from barewire_workbench.recordings.modbus_log.direction import PROTOCOLS, frame_pdu
from barewire_workbench.recordings.modbus_log.model import FormContent, LogEntry
from barewire_workbench.recordings.modbus_log.octets import Octets, split_octets
from barewire_workbench.recordings.modbus_log.stamps import find_stamp

_WORD = re.compile(
    r"(?<![A-Za-z])(?:"
    r"(?P<asked>requests?|req|query)|(?P<answered>responses?|resp|reply|answers?)"
    r"|(?P<sent>IRP_MJ_WRITE|sends?|sent|sending|txd?|transmit|transmitted|transmitting|wrote)"
    r"|(?P<received>IRP_MJ_READ|recv|rcv|receives?|received|receiving|rxd?)"
    r"|(?P<asker>master|client)|(?P<answerer>slave|server)"
    r"|(?P<out>write|writes|writing|out|output)|(?P<into>read|reads|reading|in|input)"
    r")(?![A-Za-z])",
    re.IGNORECASE,
)
_MARK = re.compile(r"(?P<sent>-+>|>>+|=>|>|[→⇒])|(?P<received><-+|<<+|<=|<|[←⇐])")
_LAST_MARK = re.compile(rf"(?:^|[\s\])])(?:{_MARK.pattern})[\s:]*$")
_GROUPS = (("asked", "answered"), ("sent", "received"), ("asker", "answerer"), ("out", "into"))
"""Which words count if there are several: "response for read request" is a response, "server received" is received."""
_SIZE = re.compile(r"[\s:=>#\[\](\-]*(?:\d+(?: ?bytes?)?)?[\s:=>#\[\])\-]*")
"""What may stand between "read" or "write" and the bytes of a frame: their number."""
_LONGEST_SIZE = 60
_NUMBER = re.compile(r"(?i)(?<![A-Za-z])(?:tx|rx):\d{4,8}-")
"""Modbus Poll counts its frames: the number belongs to the word, not to the bytes."""
_SINGLE = re.compile(r"(?<![\w.])(?:0x|\\x)?([0-9A-Fa-f]{2})[\]>]?\s*$")
"""One byte alone: a part of a frame, as slow adapters deliver it."""
_SEPARATORS = re.compile(r"[\s:=>#\[(<\])-]*")
_JOINT = re.compile(r"[\s,;|\[(]*(?:-+>|<-+|=+>|<=+|[→⇒←⇐/<>])?[\s,;:|\[(]*$")
"""What may stand between two frames of one line, apart from a word."""
_OFFSET = re.compile(r"[0-9A-Fa-f]{6,8}")
"""What stands before a colon in a line of a dump, and may be a frame by itself: 01B0 is the CRC of 0000."""
_SHORTEST = 4
"""Bytes of the shortest frame."""
_NOTHING = re.compile(r"['\"\])]*\s?[:=]\s*(?:b?''|b?\"\")?\s*")


def read_marked(lines: list[str]) -> FormContent:
    """Return the entries of lines with a direction.

    >>> read_marked(["Tx:000001-01 03 00 00 00 02", " C4 0B", "Rx:000002-01 83 02 C0 F1"]).entries[0].data.hex(" ")
    '01 03 00 00 00 02 c4 0b'
    """
    entries: list[LogEntry] = []
    known: set[int] = set()
    open_line = 0  # the line that the next one may continue
    for number, line in enumerate(lines, start=1):
        if not line:
            continue
        marked = _marked(line, number)
        if marked:
            entries += (entry for entry in marked if entry.data is not None or entry.decimal is not None)
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


def _marked(line: str, number: int) -> list[LogEntry]:
    """Return the entries of a line, one without bytes if the direction is all that it has; none for any other line."""
    stamp = find_stamp(line)
    plain = line if stamp is None else line[: stamp[1]] + " " * (stamp[2] - stamp[1]) + line[stamp[2] :]
    plain = _NUMBER.sub(lambda found: found[0][:2] + ":" + " " * (len(found[0]) - 3), plain)
    return [entry._replace(stamp=None if stamp is None else stamp[0]) for entry in _directed(plain, number)]


def _directed(plain: str, number: int) -> list[LogEntry]:
    """Return the entries of a line whose time is blank."""
    found = split_octets(plain)
    if found is None and (single := _SINGLE.search(plain)) is not None:
        word, sent, from_client = direction_of(plain[: single.start()])
        if word is not None and (word.re is not _WORD or _SEPARATORS.fullmatch(plain[word.end() : single.start()])):
            return [LogEntry(number, bytes.fromhex(single[1]), sent, from_client)]
    if found is not None and (exchange := _exchange(found, number)):
        return exchange
    before = plain if found is None else found.before
    word, sent, from_client = direction_of(before)
    if word is None:
        return []
    if found is None:
        # "recv: " without bytes
        return [LogEntry(number, None)] if _NOTHING.fullmatch(plain[word.end() :].strip()) else []
    return [LogEntry(number, found.data, sent, from_client, None, found.decimal)]


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
        if yes in ("asked", "asker"):
            return word, None, is_first
        if yes == "out" and not _SIZE.fullmatch(before[word.end() : word.end() + _LONGEST_SIZE]):
            return None, None, None  # "read 2 registers: ..." are values, not a frame
        return word, is_first, None
    plain = before.strip("[]()\t :-|,;")
    mark = _MARK.match(plain) or _LAST_MARK.search(before)
    return (None, None, None) if mark is None else (mark, mark.lastgroup == "sent", None)
