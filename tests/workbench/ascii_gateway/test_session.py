"""The text gateway, line by line: sessions on a bus in virtual time."""

from __future__ import annotations

import pytest

from barewire.canopen import (
    CanFrame,
    Entry,
    LocalNode,
    LssAddress,
    LssSlave,
    ObjectDictionary,
    PdoConfig,
    standard_objects,
)
from barewire.codecs import Value
from barewire.conversation import play
from barewire_workbench.ascii_gateway.lines import GatewayCode
from barewire_workbench.ascii_gateway.session import GatewaySession
from tests.canopen.virtual_bus import VirtualBus

ADDRESS = LssAddress(0x360, 0x10203, 0x20001, 0xDEADBEEF)
VALUES = {
    "bool": ("b", "1"),
    "i8": ("i8", "-128"),
    "i16": ("i16", "-32768"),
    "i24": ("i24", "-8388608"),
    "i32": ("i32", "-2147483648"),
    "i40": ("i40", "-549755813888"),
    "i64": ("i64", "-9223372036854775808"),
    "u8": ("u8", "255"),
    "u16": ("u16", "65535"),
    "u24": ("u24", "16777215"),
    "u32": ("u32", "4294967295"),
    "u56": ("u56", "72057594037927935"),
    "u64": ("u64", "18446744073709551615"),
    "f32": ("r32", "1.5"),
    "f64": ("r64", "3.141592653589793"),
    "string": ("vs", '"say ""no"" now, and # is no comment"'),
    "octets": ("os", "AAECAwQFBgc="),
    "unicode": ("us", "YQBiAA=="),
    "domain": ("d", "AAECAwQFBgcICQoL"),
    "time_of_day": ("t", "15659 43200000"),
    "time_difference": ("td", "0 1000"),
}
"""Name in `datatypes`, name in the gateway, and the text of a value."""
DEFAULTS: dict[str, Value] = {"string": "", "unicode": "", "octets": b"", "domain": b"", "bool": False}


def objects() -> ObjectDictionary:
    return ObjectDictionary(
        [
            *standard_objects(ADDRESS),
            Entry(0x6041, 0, "statusword", "u16", "ro", 0x0637),
            Entry(0x6040, 0, "controlword", "u16", "rw", 0),
            *(Entry(0x2000, sub, type, type, "rw", DEFAULTS.get(type, 0)) for sub, type in enumerate(VALUES, 1)),
        ]
    )


@pytest.fixture
def bus() -> VirtualBus:
    bus = VirtualBus()
    device = LocalNode(
        5, objects(), [PdoConfig("TPDO", 1, (0x60410010,), type=1), PdoConfig("RPDO", 1, (0x60400010,), type=255)]
    )
    bus.add(device, sent=device.start(0.0))
    bus.pass_time(0.1)
    return bus


def ask(bus: VirtualBus, session: GatewaySession, line: str) -> str:
    """Return the answer to a line, on a bus with a device."""
    (answer,) = bus.run(session.answer(line))
    return answer


# Reading and writing ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("block", [0, 1])
@pytest.mark.parametrize("type", VALUES)
def test_every_type_is_written_and_read(bus: VirtualBus, type: str, block: int) -> None:
    session, sub, (word, value) = GatewaySession(), list(VALUES).index(type) + 1, VALUES[type]
    assert ask(bus, session, f"[1] set sdo_block {block}") == "[1] OK"
    assert ask(bus, session, f"[2] 1 5 w 0x2000 {sub} {word} {value}  # both forms") == "[2] OK"
    assert ask(bus, session, f"[3] 5 READ 0x2000 {sub} {word}") == f"[3] {value}"


def test_a_read_without_a_type_returns_bytes_and_x_types_are_hexadecimal(bus: VirtualBus) -> None:
    session = GatewaySession()
    assert ask(bus, session, "[1] 5 r 0x6041 0") == "[1] 37 06"
    assert ask(bus, session, "[2] 5 r 24641 0 u16") == "[2] 1591"
    assert ask(bus, session, "[3] 5 r 0x6041 0 x16") == "[3] 0x0637"
    assert ask(bus, session, "[4] 5 w 0x6040 0 hex 0F 00") == "[4] OK"
    assert ask(bus, session, "[5] 5 r 0x6040 0 u16") == "[5] 15"


def test_default_net_and_node_apply_until_they_are_reset(bus: VirtualBus) -> None:
    session = GatewaySession()
    assert ask(bus, session, "[1] r 0x6041 0 u16").startswith("[1] ERROR:105 #")
    assert ask(bus, session, "[2] set node 5") == "[2] OK"
    assert ask(bus, session, "[3] r 0x6041 0 u16") == "[3] 1591"
    assert ask(bus, session, "[4] 1 set node 0") == "[4] OK"
    assert ask(bus, session, "[5] r 0x6041 0 u16").startswith("[5] ERROR:105 #")
    assert ask(bus, session, "[6] set network 0") == "[6] OK"
    assert ask(bus, session, "[7] 5 r 0x6041 0 u16").startswith("[7] ERROR:104 #")
    assert ask(bus, session, "[8] set network 1") == "[8] OK"
    assert ask(bus, session, "[9] 5 r 0x6041 0 u16") == "[9] 1591"
    assert ask(bus, session, "[10] 2 5 r 0x6041 0 u16").startswith("[10] ERROR:106 #")
    assert ask(bus, session, "[11] set network 2").startswith("[11] ERROR:106 #")
    assert ask(bus, session, "[12] 128 r 0x6041 0").startswith("[12] ERROR:107 #")
    assert ask(bus, session, "[13] 0 r 0x6041 0").startswith("[13] ERROR:107 #")


def test_refusals_of_the_node_have_its_abort_code(bus: VirtualBus) -> None:
    session = GatewaySession()
    assert ask(bus, session, "[1] 5 r 0x6999 0").startswith("[1] ERROR:0x06020000 #")
    assert ask(bus, session, "[2] 5 w 0x6041 0 u16 1").startswith("[2] ERROR:0x06010002 #")
    assert ask(bus, session, "[3] 5 r 0x6041 0 u32").startswith("[3] ERROR:0x06070010 #")
    assert ask(bus, session, "[4] set sdo_timeout 100") == "[4] OK"
    before = bus.now
    assert ask(bus, session, "[5] 6 r 0x6041 0").startswith("[5] ERROR:0x05040000 #")
    assert bus.now - before == pytest.approx(0.1, abs=0.01)


# NMT, error control, PDO -----------------------------------------------------------------------------------------


def test_nmt_commands_are_sent(bus: VirtualBus) -> None:
    session = GatewaySession()
    for sequence, (words, frame) in enumerate(
        {
            "5 start": "000#0105",
            "0 stop": "000#0200",
            "5 preop": "000#8005",
            "1 5 preoperational": "000#8005",
            "5 reset node": "000#8105",
            "5 reset comm": "000#8205",
            "5 reset communication": "000#8205",
        }.items()
    ):
        assert ask(bus, session, f"[{sequence}] {words}") == f"[{sequence}] OK"
        assert bus.log[-1][1] == frame or bus.log[-2][1] == frame


def feed(session: GatewaySession, text: str | None, now: float) -> tuple[list[str], list[str]]:
    frames, lines = session.notices.feed(None if text is None else CanFrame.parse(text), now)
    return [str(frame) for frame in frames], lines


def answer_to(session: GatewaySession, line: str, now: float = 0.0) -> str:
    """Return the answer to a line that needs no device."""
    (answer,) = play(session.answer(line), lambda frame, at: [], start=now)[0]
    return answer


def test_boot_ups_emergencies_and_bus_errors_are_reported_when_they_are_asked_for() -> None:
    session = GatewaySession(net=3)

    def heard(now: float) -> list[str]:
        lines = feed(session, "705#00", now)[1] + feed(session, "085#3081110102030405", now)[1]
        return lines + session.notices.bus_error(GatewayCode.BUS_OFF, "bus off")

    assert heard(0.0) == []
    assert answer_to(session, "[1] boot_up_indication Enable") == "[1] OK"
    assert heard(1.0) == ["3 5 BOOT_UP"]
    assert answer_to(session, "[2] _emcy_indication enable") == "[2] OK"
    assert answer_to(session, "[3] 3 boot_up_indication Disable") == "[3] OK"
    assert heard(2.0) == ["3 5 EMCY 8130 11 1 2 3 4 5"]
    assert answer_to(session, "[4] _emcy_indication disable") == "[4] OK"
    assert answer_to(session, "[5] _bus_indication enable") == "[5] OK"
    assert heard(3.0) == ["3 ERROR 301 #bus off"]


def test_a_session_with_indications_reports_them_from_the_start() -> None:
    session = GatewaySession(indications=True)
    assert feed(session, "705#00", 0.0)[1] == ["1 5 BOOT_UP"]
    assert feed(session, "085#3081110102030405", 0.1)[1] == ["1 5 EMCY 8130 11 1 2 3 4 5"]
    assert session.notices.bus_error(GatewayCode.BUS_OFF, "bus off") == ["1 ERROR 301 #bus off"]


def test_a_lost_heartbeat_is_reported() -> None:
    session = GatewaySession()
    assert feed(session, "705#05", 0.0)[1] == []
    assert answer_to(session, "[1] 5 enable heartbeat 500") == "[1] OK"
    assert feed(session, "705#05", 1.0)[1] == ["1 5 ERROR 202 #heartbeat started"]
    assert feed(session, "705#7F", 1.2)[1] == ["1 5 ERROR 204 #its NMT state is now 7Fh"]
    assert session.notices.deadline == pytest.approx(1.7)
    assert feed(session, None, 1.7)[1] == ["1 5 ERROR 203 #heartbeat lost"]
    assert answer_to(session, "[2] 5 disable heartbeat") == "[2] OK"
    assert feed(session, "705#7F", 2.0)[1] == []
    assert session.notices.deadline is None


def test_node_guarding_reports_toggle_errors_and_silence() -> None:
    session = GatewaySession()
    assert answer_to(session, "[1] 5 enable guarding 100 3", now=10.0) == "[1] OK"
    assert feed(session, None, 10.0) == (["705#R1"], [])
    assert feed(session, "705#05", 10.01)[1] == []
    assert feed(session, None, 10.1) == (["705#R1"], [])
    assert feed(session, "705#05", 10.11)[1] == ["1 5 ERROR 200 #the toggle bit did not alternate"]
    assert feed(session, None, 10.4)[1] == ["1 5 ERROR 201 #no answer to guarding"]
    assert answer_to(session, "[2] 5 disable guarding") == "[2] OK"
    assert session.notices.deadline is None


def test_a_received_pdo_is_reported_and_stored() -> None:
    session = GatewaySession()
    assert answer_to(session, "[1] set rpdo 1 0x185 event 3 0x6041 0 u16 0x2005 0 i16 0x2006 0 b") == "[1] OK"
    assert answer_to(session, "[2] read pdo 1") == "[2] 1 pdo 1 3 0x0000 0x0000 0"
    assert feed(session, "185#3706FEFF01", 0.0) == ([], ["1 pdo 1 3 0x0637 0xFFFE 1"])
    assert feed(session, "185#3706FE", 0.1) == ([], [])
    assert answer_to(session, "[3] r p 1") == "[3] 1 pdo 1 3 0x0637 0xFFFE 1"
    assert answer_to(session, "[4] w p 1 3 1 2 1").startswith("[4] ERROR:102 #")
    assert answer_to(session, "[5] set rpdo 2 0x185 event 1 0x6041 0 u16").startswith("[5] ERROR:400 #")
    assert answer_to(session, "[6] set rpdo 1 0x185 event 0") == "[6] OK"
    assert answer_to(session, "[7] r p 1").startswith("[7] ERROR:102 #")
    assert answer_to(session, "[8] set rpdo 1 0x185 event 2 0x6041 0 u64 0x2000 0 u8").startswith("[8] ERROR:401 #")


def test_a_pdo_is_sent_by_its_transmission_type() -> None:
    def sends(session: GatewaySession, line: str) -> list[str]:
        sent: list[str] = []

        def record(frame: CanFrame, at: float) -> list[tuple[float, CanFrame]]:
            sent.append(str(frame))
            return []

        assert play(session.answer(line), record)[0] == [line[: line.index("]") + 1] + " OK"]
        return sent

    event = GatewaySession()
    assert sends(event, "[1] set tpdo 1 0x205 event 1 0x6040 0 u16") == []
    assert feed(event, None, 1.0) == ([], [])
    assert sends(event, "[2] write pdo 1 1 0x000F") == ["205#0F00"]
    assert sends(event, "[3] write pdo 1 1 15") == ["205#0F00"]
    synced = GatewaySession()
    assert sends(synced, "[1] set tpdo 1 0x205 sync2 1 0x6040 0 u16") == []
    assert sends(synced, "[2] write pdo 1 1 15") == []
    assert [feed(synced, "080#", now)[0] for now in (0.0, 0.1, 0.2, 0.3)] == [[], ["205#0F00"], [], ["205#0F00"]]
    remote = GatewaySession()
    assert sends(remote, "[1] set tpdox 1 0x205 rtr 0 0 0 1 0x6040 0 u16") == []
    assert sends(remote, "[2] write pdo 1 1 15") == []
    assert feed(remote, "205#R2", 0.0)[0] == ["205#0F00"]


def test_pdos_are_exchanged_with_a_device(bus: VirtualBus) -> None:
    session = GatewaySession()
    for line in ("set rpdo 1 0x185 event 1 0x6041 0 u16", "set tpdo 1 0x205 event 1 0x6040 0 u16", "5 start"):
        assert ask(bus, session, f"[1] {line}") == "[1] OK"
    assert ask(bus, session, "[2] w p 1 1 7") == "[2] OK"
    assert ask(bus, session, "[3] 5 r 0x6040 0 u16") == "[3] 7"
    bus.inject("080#", bus.now)
    received = bus.pass_time(0.01)
    assert [line for text in received for line in feed(session, text, bus.now)[1]] == ["1 pdo 1 1 0x0637"]


# LSS -------------------------------------------------------------------------------------------------------------


@pytest.fixture
def unconfigured() -> VirtualBus:
    bus = VirtualBus()
    slave = LssSlave(ADDRESS, store=lambda node, rate: True)
    device = LocalNode(None, ObjectDictionary(standard_objects(ADDRESS)), lss=slave)
    bus.add(device, sent=device.start(0.0))
    return bus


FOUND = "0x00000360 0x00010203 0x00020001 0xDEADBEEF"


def test_lss_commands_configure_a_device(unconfigured: VirtualBus) -> None:
    bus, session = unconfigured, GatewaySession()
    assert ask(bus, session, "[1] lss_ident_nonconf") == "[1] OK"
    assert ask(bus, session, "[2] lss_identity 0x360 0x10203 0 0xFFFFFFFF 0 0xFFFFFFFF") == "[2] OK"
    assert ask(bus, session, "[3] lss_identity 0x361 0x10203 0 0xFFFFFFFF 0 0xFFFFFFFF").startswith("[3] ERROR:103 #")
    assert ask(bus, session, "[4] lss_switch_sel 1 2 3 4").startswith("[4] ERROR:103 #")
    assert ask(bus, session, f"[5] lss_switch_sel {FOUND}") == "[5] OK"
    assert ask(bus, session, "[6] lss_inquire_addr") == f"[6] {FOUND}"
    assert ask(bus, session, "[7] lss_inquire_addr 3") == "[7] 0xDEADBEEF"
    assert ask(bus, session, "[8] lss_inquire_addr 0x5A") == "[8] 0x00000360"
    assert ask(bus, session, "[9] lss_get_node") == "[9] 0xFF"
    assert ask(bus, session, "[10] lss_conf_bitrate 0 200").startswith("[10] ERROR:503 #")
    assert ask(bus, session, "[11] lss_conf_bitrate 0 4") == "[11] OK"
    assert ask(bus, session, "[12] 1 lss_set_node 7") == "[12] OK"
    assert ask(bus, session, "[13] lss_store") == "[13] OK"
    assert ask(bus, session, "[14] lss_get_node") == "[14] 0xFF"  # the new node-ID is valid after the next boot
    assert ask(bus, session, "[15] lss_switch_glob 0") == "[15] OK"
    assert "707#00" in bus.pass_time(1.0)
    assert ask(bus, session, "[16] lss_store").startswith("[16] ERROR:103 #")


def test_lss_scans_find_a_device(unconfigured: VirtualBus) -> None:
    bus, session = unconfigured, GatewaySession()
    assert ask(bus, session, "[1] _lss_fastscan") == f"[1] {FOUND}"
    assert ask(bus, session, "[2] lss_switch_glob 0") == "[2] OK"
    assert bus.run(session.answer("[3] lss_allnodes 100 9 0 2 0x361 0 0 0 0 0 0")) == ["# 0 found", "[3] OK"]
    assert bus.run(session.answer("[4] lss_allnodes 100 9 0 2 0x360 1 0 0 0 0 0")) == [
        f"# node 9: {FOUND}",
        "# 1 found",
        "[4] OK",
    ]
    assert ask(bus, session, "[5] _lss_fastscan 100").startswith("[5] ERROR:103 #")
