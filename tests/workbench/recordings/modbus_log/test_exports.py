"""Exports of Wireshark, and the output of serial sniffers. The files in `samples/` were written by tshark 4.0, socat
1.7.4, jpnevulator 2.3.6 and strace 6.1; interceptty, slsnif, asyn, eModbus, Saleae Logic and Serial Port Monitor do not
run here: their lines are as their sources and documentation have them."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from barewire.errors import DecodeError
from barewire.rtu import encode as rtu_frame
from barewire.tcp import encode as tcp_frame
from barewire_workbench.recordings.capture import PacketBuilder, file_header, packet_block
from barewire_workbench.recordings.modbus_log import LoggedBytes, read_modbus_log
from barewire_workbench.recordings.model import Unread
from tests.helpers import refused, some_of, unhex
from tests.workbench.recordings.modbus_log.test_programs import READ, REFUSED, SAMPLES, WRITE, lines_of

ALL = [f"{READ}11 22", WRITE, REFUSED]
DECLINED = [REFUSED.replace("FFFFh", "0005h")]


@pytest.mark.parametrize(
    ("name", "form", "timed", "lines"),
    [
        ("tshark-rtu-bytes.txt", "Wireshark", False, ALL),
        ("tshark-tcp-summary-and-bytes.txt", "Wireshark", True, ALL),
        ("tshark-tcp-follow.txt", "Wireshark", False, ALL),
        ("tshark-tcp.csv", "CSV", True, ALL),
        ("socat-x.log", "blocks", True, [f"{READ}0 0", WRITE, REFUSED]),
        ("socat-xv.log", "blocks", True, [f"{READ}0 0", WRITE, REFUSED]),
        ("jpnevulator.log", "blocks", True, ALL[:1]),
        ("strace.log", "strace", True, [f"{READ}0 0"]),
    ],
)
def test_samples(name: str, form: str, timed: bool, lines: list[str]) -> None:
    data = (SAMPLES / name).read_bytes()
    log = read_modbus_log(data)
    assert (log.form, log.timed) == (form, timed)
    assert lines_of(data) == lines
    assert all(item.line for item in log.items)


def test_nine_digits_of_socat_are_microseconds() -> None:
    """socat 1.7.4 pads microseconds with zeros to nine digits: the answer came after 7.6 ms, not after 7.6 µs."""
    first, second = read_modbus_log((SAMPLES / "socat-x.log").read_bytes()).items[:2]
    assert round(second.at - first.at, 4) == 0.0076


def test_an_export_without_bytes_is_refused() -> None:
    with refused(DecodeError, "line 1: an export of Wireshark without bytes: add them"):
        read_modbus_log((SAMPLES / "tshark-without-bytes.txt").read_bytes())


ASKED, ANSWERED = ["01", "03", "00", "05", "00", "02", "d4", "0a"], ["01", "83", "02", "c0", "f1"]
TIMED = [*enumerate(ASKED), *enumerate(ANSWERED, 60)]
NAMES = [
    "interceptty",
    "interceptty-T",
    "slsnif",
    "slsnif-hex",
    "asyn",
    "monitor",
    "portmon",
    "eModbus",
    "saleae-1",
    "saleae-2",
]
MESSAGES = [("0300050002", True), ("0304000B0016", False), ("0600070003", True), ("0600070003", False),
            ("03FFFF0002", True), ("8302", False)]  # fmt: skip


def capture(protocol: str) -> bytes:
    packer, data, number = PacketBuilder(), file_header(), 0
    for place, (digits, from_client) in enumerate(MESSAGES):
        pdu, number = unhex(digits), number + from_client
        if protocol == "tcp":
            packet = packer.tcp(tcp_frame(1, pdu, number), from_client=from_client)
        else:
            packet = packer.rtu(rtu_frame(1, pdu), from_client=from_client)
        data += packet_block(1_700_000_000 + place / 4, packet)
    return data


OPTIONS = ("-V -x", "-T json -x", "-T jsonraw", "-T ek", "-x", "-P -x", "-T json")
"""The first four have no file in `samples/`: tshark writes them in `make test`."""
EXPORTS = sorted(
    [(protocol, options) for options in OPTIONS for protocol in ("tcp", "rtu")],
    key=lambda export: (OPTIONS.index(export[1]) % 2 == 0) != (export[0] == "tcp"),
)
"""The half that comes first has each option once."""


@pytest.mark.long
@pytest.mark.needs("tshark")
@pytest.mark.parametrize("export_of", some_of(EXPORTS, 4), ids=" ".join)
def test_every_export_of_tshark(export_of: tuple[str, str], tmp_path: Path) -> None:
    protocol, options = export_of
    file = tmp_path / "line.pcapng"
    file.write_bytes(capture(protocol))
    command = ["tshark", "-r", str(file), "-o", "mbrtu.udp.port:5020", *options.split()]
    export = subprocess.run(command, capture_output=True, check=True, timeout=30).stdout
    assert lines_of(export) == ALL
    log = read_modbus_log(export)
    assert [item.from_client for item in log.items if isinstance(item, LoggedBytes)] == [asked for _, asked in MESSAGES]
    assert not [item for item in log.items if isinstance(item, Unread)]
    if "-V" in options or "json -x" in options or "ek" in options:
        assert [item.at - 1_700_000_000 for item in log.items] == [place / 4 for place in range(6)]


def test_c_arrays() -> None:
    arrays = [
        "/* Frame (66 bytes) */",
        "static const unsigned char pkt1[66] = {",
        *_rows(PacketBuilder().tcp(tcp_frame(1, unhex("03 0005 0002"), 1), from_client=True)),
        "};",
    ]
    assert lines_of("\n".join(arrays).encode()) == [f"{READ}the recording ends here"]
    peers = ["char peer0_0[] = { /* Packet 1 */", *_rows(unhex("0001 0000 0006 0103 0005 0002")), "};"]
    peers += ["char peer1_0[] = { /* Packet 2 */", *_rows(unhex("0001 0000 0003 0183 02")), "};"]
    assert lines_of("\n".join(peers).encode()) == DECLINED


def _rows(data: bytes) -> list[str]:
    return [", ".join(f"0x{byte:02x}" for byte in data[at : at + 8]) + f", /* {at} */" for at in range(0, len(data), 8)]


@pytest.mark.parametrize(
    "text",
    [
        # interceptty, and with -T
        "".join(f"> \t0x{byte} (x)\n" for byte in ASKED)
        + "".join(f"< 0x{byte}\n" for byte in ANSWERED),
        "[12:01 07.000100]> \t0x01\n" + "".join(f"                 > \t0x{byte}\n" for byte in ASKED[1:])
        + "[12:01 07.030100]< 0x01\n" + "".join(f"                 < 0x{byte}\n" for byte in ANSWERED[1:]),
        # slsnif: decimal with times, --hex
        "\n\nMon May 11 13:17:34.79 2026\nHost   --> [SOH] (001) [ETX] (003) [NUL] (000) [ENQ] (005) [NUL] (000) "
        "[STX] (002) \xd4 (212) [LF] (010) \n\nMon May 11 13:17:34.92 2026\n"
        "Device --> [SOH] (001) \x83 (131) [STX] (002) \xc0 (192) \xf1 (241) ",
        "Host   --> [SOH] (01) [ETX] (03) [NUL] (00) [ENQ] (05) [NUL] (00) [STX] (02) \xd4 (d4) [LF] (0a) \n"
        "Device --> [SOH] (01) \x83 (83) [STX] (02) \xc0 (c0) \xf1 (f1) \nTotal bytes transmitted: 5",
        # EPICS asyn
        "2026/05/11 13:17:34.792 gsets22:4002 write 8\n\n01 03 00 05 00 02 d4 0a\n"
        "2026/05/11 13:17:34.821 gsets22:4002 read 5\n\n01 83 02 c0\nf1\n",
        # Serial Port Monitor
        "[23/10/2008 10:38:33]\n3  IRP_MJ_WRITE - Request transfers data from a client to a COM port (COM5)\n"
        "   STATUS_SUCCESS\n   01 03 00 05 00 02 d4 0a                  ........\n--------------\n"
        "[23/10/2008 10:38:33]\n5  IRP_MJ_READ - Transfers data from a COM port to a client (COM5)\n"
        "   STATUS_SUCCESS\n   01 83 02 c0 f1                           .....\n",
        # PortMon
        "12\t0.00002\tplc.exe\tIRP_MJ_WRITE\tSerial0\tSUCCESS\tLength 8: 01 03 00 05 00 02 D4 0A\n"
        "13\t0.00002\tplc.exe\tIRP_MJ_READ\tSerial0\tSUCCESS\tLength 5: 01 83 02 C0 F1\n",
        # eModbus
        "[D] Sent packet: @3FFB890C/8:\n  | 0000: 01 03 00 05 00 02 d4 0a             |........        |\n"
        "[D] Received packet: @3FFB890C/5:\n  | 0000: 01 83 02 c0 f1                   |.....           |\n",
        # Saleae Logic 1 and 2
        "Time [s],Value,Parity Error,Framing Error\n"
        + "".join(f"{at / 1000:.6f},0x{byte},,\n" for at, byte in TIMED),
        'name,type,start_time,duration,"data"\n'
        + "".join(f'"Async Serial","data",{at / 1000},0.001,0x{byte}\n' for at, byte in TIMED),
    ],
    ids=NAMES,
)  # fmt: skip
def test_serial_sniffers(text: str) -> None:
    log = read_modbus_log(text.encode())
    assert lines_of(text.encode()) == DECLINED
    assert not [item for item in log.items if isinstance(item, Unread)]
    assert lines_of(text.encode("utf-16")) == DECLINED  # as PowerShell redirects output


def test_a_log_in_latin_1() -> None:
    text = "Gerät 1 Tx: 01 03 00 05 00 02 D4 0A\nGerät 1 Rx: 01 83 02 C0 F1\n"
    assert lines_of(text.encode("latin-1")) == DECLINED


def test_two_forms_that_differ_are_an_error() -> None:
    line = r'recv: 0x1 0x83 0x2 0xc0 0xf1 write(3, "\1\3\0\5\0\2\324\n", 8) = 8'
    text = 'read(3, "\\1\\203\\2\\300\\361", 5) = 5\n' + line
    log = read_modbus_log(text.encode())
    assert log.form == "strace"
    both = "[01][83][02][C0][F1] Response from instrument: 01 83 02 C0 F2 (5 bytes)"
    with refused(DecodeError, "line 1 reads as libmodbus and as MinimalModbus, with different bytes"):
        read_modbus_log(both.encode())
