"""Traffic of a client in the notations in which people post it: of libraries, of devices' logs, of their own programs.

Each writer takes the entries of one log, and returns its text. The recorder is the client: `sent` are its requests.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple


class Entry(NamedTuple):
    """Bytes that the client sent or received together, at a time of the day in seconds."""

    at: float
    sent: bool
    data: bytes


Writer = Callable[[list[Entry]], str]


def _time(at: float) -> str:
    whole = int(at)
    return f"{whole // 3600:02d}:{whole // 60 % 60:02d}:{at % 60:06.3f}"


def _hex(data: bytes, separator: str = " ", prefix: str = "") -> str:
    return separator.join(f"{prefix}{byte:02x}" for byte in data)


def _short(data: bytes) -> str:
    return " ".join(f"0x{byte:x}" for byte in data)


def _decimal(data: bytes, separator: str = ", ") -> str:
    return separator.join(map(str, data))


def lines(sent: str, received: str, form: Callable[[bytes], str], *, timed: str = "{time} ") -> Writer:
    """Return the writer of a log with a line for each entry: a time, a word for the direction, and the bytes."""

    def write(entries: list[Entry]) -> str:
        rows = (
            timed.format(time=_time(at), seconds=f"{at:.6f}")
            + (sent if is_sent else received).format(form(data), n=len(data))
            for at, is_sent, data in entries
        )
        return "\n".join(rows) + "\n"

    return write


def _libmodbus(entries: list[Entry]) -> str:
    rows: list[str] = []
    for place, (_, sent, data) in enumerate(entries):
        follows = entries[place + 1 : place + 2]
        if sent:
            rows += ["[" + _hex(data, "][").upper() + "]", "Waiting for a confirmation..."]
            if not follows or follows[0].sent:
                rows.append("ERROR Connection timed out: select")
        elif place and not entries[place - 1].sent:
            rows[-1] += "<" + _hex(data, "><").upper() + ">"
        else:
            rows.append("<" + _hex(data, "><").upper() + ">")
    return "\n".join(rows) + "\n"


def _minimalmodbus(entries: list[Entry]) -> str:
    def rows() -> Iterator[str]:
        for place, (_, sent, data) in enumerate(entries):
            digits, size = _hex(data).upper(), f"({len(data)} bytes)"
            if sent:
                yield f"MinimalModbus debug mode. Will write to instrument (expecting 9 bytes back): {digits} {size}"
                if not entries[place + 1 : place + 2] or entries[place + 1].sent:
                    yield "MinimalModbus debug mode. Response from instrument:  (0 bytes), roundtrip time: 51.0 ms."
            else:
                yield f"MinimalModbus debug mode. Response from instrument: {digits} {size}, roundtrip time: 12.3 ms."

    return "\n".join(rows()) + "\n"


def _dump(entries: list[Entry]) -> str:
    def rows() -> Iterator[str]:
        for at, sent, data in entries:
            yield f"{_time(at)} {'TX' if sent else 'RX'} {len(data)} bytes:"
            for offset in range(0, len(data), 8):
                row = data[offset : offset + 8]
                characters = "".join(chr(byte) if 32 <= byte < 127 else "." for byte in row)
                yield f"{offset:04x}: {_hex(row):24} {characters}"

    return "\n".join(rows()) + "\n"


def _wrapped(entries: list[Entry]) -> str:
    def rows() -> Iterator[str]:
        for at, sent, data in entries:
            yield f"{_time(at)} {'Tx' if sent else 'Rx'}: {_hex(data[:5])}"
            if data[5:]:
                yield _hex(data[5:])

    return "\n".join(rows()) + "\n"


def _joined(entries: list[Entry]) -> str:
    """An exchange in a line."""
    text = ""
    for place, (_, sent, data) in enumerate(entries):
        text += ("\n" if sent and place else "" if sent else " ") + ("TX: " if sent else "RX: ") + _hex(data)
    return text + "\n"


def _spaced(entries: list[Entry]) -> str:
    return "".join(
        "".join(f"[ {byte:02X} ]" if sent else f"< {byte:02X} >" for byte in data) + "\n" for _, sent, data in entries
    )


def _python(data: bytes) -> str:
    return repr(data)


def _escaped(data: bytes) -> str:
    return "".join(f"\\x{byte:02x}" for byte in data)


_NAMED = {7: "a", 8: "b", 9: "t", 10: "n", 11: "v", 12: "f", 13: "r", 27: "e", 34: '"', 39: "'", 92: "\\"}


def _characters(data: bytes) -> str:
    """Return a string as the programs print it that leave the characters of ASCII as they are."""
    return "".join(
        f"\\{_NAMED[byte]}" if byte in _NAMED else chr(byte) if 32 <= byte < 127 else f"\\x{byte:02X}" for byte in data
    )


def _words(data: bytes) -> str:
    return " ".join(data[at : at + 2].hex() for at in range(0, len(data), 2))


NOTATIONS: dict[str, Writer] = {
    # logs of libraries
    "pymodbus 3": lines("send: {}", "recv: {} extra data: ", _short, timed="2024-04-07 {time} DEBUG logging:103 "),
    "pymodbus 3.2": lines("send: {}", "recv: {} old_data:  addr=None", _short, timed="DEBUG:pymodbus.logging:"),
    "pymodbus 2": lines("SEND: {}", "RECV: {}", _short, timed="2022-07-13 {time} MainThread DEBUG transaction :273 "),
    "libmodbus": _libmodbus,
    "minimalmodbus": _minimalmodbus,
    "modbus_tk": lines("-> {}", "<- {}", lambda data: _decimal(data, "-"), timed="DEBUG\tmodbus.execute\tThread-1\t"),
    "ESPHome uart": lines(">>> {}", "<<< {}", lambda d: _hex(d, ":").upper(), timed="[{time}][D][uart_debug:114]: "),
    "ESPHome uart decimal": lines(
        ">>> {}", "<<< {}", lambda d: _decimal(d, ","), timed="[{time}][D][uart_debug:158]: "
    ),
    "ESPHome uart string": lines('>>> "{}"', '<<< "{}"', _escaped, timed="[{time}][D][uart_debug:176]: "),
    "ESPHome modbus": lines(
        "Modbus write: {} ({n}) at 4666",
        "Modbus received: {} ({n}) at 4667",
        lambda d: _hex(d, ".").upper(),
        timed="[{time}][V][modbus:221]: ",
    ),
    "goburrow": lines("modbus: sending {}", "modbus: received {}", _hex, timed="2024/03/14 {time} "),
    "evcc": lines("modbus: send {}", "modbus: recv {}", _hex, timed="[modbus] TRACE 2024/03/14 {time} "),
    "modbus-serial": lines(
        "modbus-serial {{ action: 'send serial rtu buffered', data: <Buffer {}>, unitid: 1 }}",
        "modbus-serial {{ action: 'receive serial rtu buffered port', data: <Buffer {}> }}",
        _hex,
        timed="2024-03-14T{time}Z ",
    ),
    "Buffer": lines("write <Buffer {}>", "resp <Buffer {}>", _hex, timed=""),
    "JSON buffer": lines(
        'tx {{"type":"Buffer","data":[{}]}}', 'rx {{"type":"Buffer","data":[{}]}}', lambda d: _decimal(d, ","), timed=""
    ),
    "NModbus": lines("TX: {}", "RX: {}", _decimal, timed=""),
    "mbusd": lines("request: {}", "response: {}", lambda d: "".join(f"\\{byte:02x}" for byte in d), timed=""),
    "Rust": lines("Sending: {}", "Received: {}", lambda d: f"[{_decimal(d)}]", timed="[2024-03-14T{time}Z DEBUG] "),
    "Rust hex": lines("TX [{}]", "RX [{}]", lambda d: _hex(d, ", "), timed="[2024-03-14T{time}Z TRACE rmodbus] "),
    # programs
    "Modbus Poll": lines("Tx:000001-{}", "Rx:000002-{}", lambda d: _hex(d).upper(), timed=""),
    "QModMaster": lines("[RTU]>Tx > {}", "[RTU]>Rx > {}", lambda d: "05:052 - " + _hex(d, "  ").upper(), timed=""),
    "Docklight": lines("[TX] - {}", "[RX] - {}", lambda d: _hex(d).upper(), timed="05/01/2024 {time} "),
    "syslog": lines("TX {}", "RX {}", _hex, timed="Nov 28 {time} host prog[1234]: "),
    "log4j": lines("Sent: {}", "Got: {}", _hex, timed="2019-03-14 {time} DEBUG [main] c.e.Client - "),
    "C# dashes": lines("Send: {}", "Receive: {}", lambda d: _hex(d, "-").upper(), timed="14.03.2019 {time} "),
    # own programs
    "Tx/Rx": lines("TX: {}", "RX: {}", lambda d: _hex(d).upper()),
    "tx=rx=": lines("tx={}", "rx={}", lambda d: _hex(d, ""), timed="t={seconds} "),
    "Req/Resp": lines("Req: {}", "Resp: {}", lambda d: _hex(d).upper(), timed=""),
    "send/rec": lines("send: {}", "rec: {}", lambda d: _hex(d).upper(), timed=""),
    "Anfrage/Antwort": lines("Anfrage: {}", "Antwort: {}", lambda d: _hex(d).upper(), timed=""),
    "发送/接收": lines("发送: {}", "接收: {}", lambda d: _hex(d).upper()),
    "Query/Answer": lines("Query: {}", "Answer: {}", lambda d: _hex(d).upper(), timed=""),
    "Master/Slave": lines("Master: {}", "Slave: {}", lambda d: _hex(d).upper(), timed=""),
    "Request sent/Response received": lines("Request sent: {}", "Response received: {}", _hex),
    "OUT/IN": lines("OUT {}", "IN  {}", _hex),
    "arrows": lines("-> {}", "<- {}", _hex),
    "wide arrows": lines("--> {}", "<-- {}", _hex, timed=""),
    "chevrons": lines(">>> {}", "<<< {}", _hex, timed=""),
    "marks": lines("> {}", "< {}", _hex, timed=""),
    "brackets": lines("TX: {}", "RX: {}", lambda d: "[" + _hex(d, "][").upper() + "]", timed=""),
    "spaced brackets": _spaced,
    "angles": lines("Sent <{}>", "Received <{}>", lambda d: _hex(d, "><").upper(), timed=""),
    "C arrays": lines("uint8_t tx[] = {{{}}};", "uint8_t rx[] = {{{}}};", lambda d: _hex(d, ", ", "0x"), timed=""),
    "braces": lines("request {{{}}}", "response {{{}}}", lambda d: _hex(d, ", ", "0x"), timed=""),
    "Python bytes": lines("Sending: {}", "Received: {}", _python, timed="{time} DEBUG "),
    "Python assigned": lines("request = {}", "response = {}", _python, timed=""),
    "Python list": lines("sent [{}]", "received [{}]", _decimal, timed=""),
    "Python hex list": lines("send ['{}']", "recv ['{}']", lambda d: "', '".join(map(hex, d)), timed=""),
    "bytearray": lines("write bytearray({})", "read bytearray({})", _python, timed=""),
    "hexlify": lines("Sent: {}", "Received: {}", lambda d: repr(d.hex().encode()), timed=""),
    "joined digits": lines("TX: {}", "RX: {}", lambda d: d.hex().upper(), timed=""),
    "0x digits": lines("TX: 0x{}", "RX: 0x{}", lambda d: d.hex().upper(), timed=""),
    "commas": lines("Tx: {}", "Rx: {}", lambda d: _hex(d, ","), timed=""),
    "0x commas": lines("Tx: {}", "Rx: {}", lambda d: _hex(d, ", ", "0x"), timed=""),
    "pipes": lines("Tx: {}", "Rx: {}", lambda d: _hex(d, "|"), timed=""),
    "h": lines("Tx: {}", "Rx: {}", lambda d: " ".join(f"{byte:02X}h" for byte in d), timed=""),
    "short digits": lines("Tx: {}", "Rx: {}", lambda d: " ".join(f"{byte:X}" for byte in d), timed=""),
    "decimal blanks": lines("TX {}", "RX {}", lambda d: _decimal(d, " "), timed=""),
    "three digits": lines("TX {}", "RX {}", lambda d: "".join(f"[{byte:03d}]" for byte in d), timed=""),
    "escaped": lines('write("{}")', 'read("{}")', _escaped, timed=""),
    "characters": lines('>>> "{}"', '<<< "{}"', _characters, timed="[{time}][D][uart_debug:158]: "),
    "quotes of a forum": lines(
        ">>> \u201c{}\u201d", "<<< \u201c{}\u201d", _characters, timed="[{time}][D][uart_debug:158]: "
    ),
    "bold": lines("I send **{}** to it", "and get **{}** back", _hex, timed=""),
    "code in a sentence": lines("It sends `{}`,", "and `{}` comes back.", lambda d: _hex(d).upper(), timed=""),
    "words of two bytes": lines("Request: {}", "Response: {}", _words, timed=""),
    "octal": lines('TX "{}"', 'RX "{}"', lambda d: "".join(f"\\{byte:03o}" for byte in d), timed=""),
    "remarks": lines("{}   // request", "{}   // response", lambda d: _hex(d).upper(), timed=""),
    "counts": lines("Send ({n} bytes): {}", "Receive ({n} bytes): {}", _hex),
    "counts behind": lines("TX: {} ({n} bytes)", "RX: {} ({n} bytes)", _hex),
    "ASCII column": lines(
        "TX {}", "RX {}", lambda d: f"{_hex(d)}  |{''.join(chr(b) if 32 <= b < 127 else '.' for b in d)}|"
    ),
    "bare": lines("{}", "{}", lambda d: _hex(d).upper(), timed=""),
    "bare with times": lines("{}", "{}", lambda d: _hex(d).upper(), timed="{seconds} "),
    "bare joined": lines("{}", "{}", lambda d: d.hex(), timed=""),
    "dump": _dump,
    "wrapped": _wrapped,
    "in a line": _joined,
}


def chosen(names: Iterable[str] = ()) -> dict[str, Writer]:
    """Return the notations with these names, or all of them."""
    wanted = set(names)
    return {name: writer for name, writer in NOTATIONS.items() if not wanted or name in wanted}
