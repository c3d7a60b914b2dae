"""A whole node: states, boot-up, heartbeat, SDO and PDO together, in virtual time."""

from __future__ import annotations

import pytest

from barewire.canopen import CanFrame, Entry, LocalNode, NmtCommand, NmtState, ObjectDictionary, PdoConfig
from barewire.canopen.communication_objects import standard_objects
from barewire.codecs import Value
from barewire.errors import EncodeError

# The PDOs with which an AZ3 leaves the factory: all synchronous.
AZ3_PDOS = (
    PdoConfig("RPDO", 1, (0x60400010, 0x60FF0020), type=0),
    PdoConfig("RPDO", 2, (0x60400010, 0x607A0020), type=0),
    PdoConfig("RPDO", 3, (0x60400010, 0x206A0120), type=0),
    PdoConfig("RPDO", 4, (0x60400010, 0x60710010), type=0),
    PdoConfig("TPDO", 1, (0x60410010, 0x20050010, 0x20020010, 0x20060010), type=1),
    PdoConfig("TPDO", 2, (0x60410010, 0x60640020, 0x20690010), type=1),
    PdoConfig("TPDO", 3, (0x60410010, 0x606C0020, 0x20690010), type=1),
    PdoConfig("TPDO", 4, (0x60410010, 0x60770010, 0x20690010), type=1),
)


def az3_objects() -> ObjectDictionary:
    return ObjectDictionary(
        [
            Entry(0x1000, 0, "device type", "u32", "ro", 0x00020192),
            Entry(0x1001, 0, "error register", "u8", "ro", 0),
            Entry(0x1017, 0, "heartbeat time", "u16", "rw", 0),
            Entry(0x2002, 0, "current", "i16", "ro", 25),
            Entry(0x2005, 0, "velocity", "i16", "ro", -1000),
            Entry(0x2006, 0, "position", "i16", "ro", 1),
            Entry(0x2069, 0, "error", "u16", "ro", 0),
            Entry(0x206A, 1, "vref set point", "f32", "rw", 0.0),
            Entry(0x6040, 0, "controlword", "u16", "rw", 0),
            Entry(0x6041, 0, "statusword", "u16", "ro", 0x0637),
            Entry(0x6064, 0, "position actual", "i32", "ro", -2),
            Entry(0x606C, 0, "velocity actual", "i32", "ro", 25000),
            Entry(0x6071, 0, "target torque", "i16", "rw", 0),
            Entry(0x6077, 0, "torque actual", "i16", "ro", -5),
            Entry(0x607A, 0, "target position", "i32", "rw", 0),
            Entry(0x60FF, 0, "target velocity", "i32", "rw", 0),
        ]
    )


def device_with(*pdos: PdoConfig, start: bool = True, operational: bool = True) -> LocalNode:
    device = LocalNode(5, az3_objects(), pdos)
    if start:
        device.start(0.0)
    if operational:
        feed(device, "000#0105")
    return device


def feed(device: LocalNode, text: str | None, now: float = 0.0) -> list[str]:
    return [str(frame) for frame in device.feed(None if text is None else CanFrame.parse(text), now)]


READ_STATUS, STATUS = "605#4041600000000000", "585#4B41600037060000"


def test_before_start_nothing_is_sent_or_received() -> None:
    device = device_with(*AZ3_PDOS, start=False, operational=False)
    for text in (READ_STATUS, "000#0105", "080#", None):
        assert feed(device, text, 5.0) == []
    assert device.state is NmtState.INITIALISING
    assert device.deadline is None


def test_it_boots_once_into_pre_operational() -> None:
    device = LocalNode(5, az3_objects())
    assert [str(frame) for frame in device.start(0.0)] == ["705#00"]
    assert device.state is NmtState.PRE_OPERATIONAL
    assert feed(device, None, 100.0) == []


def test_services_depend_on_the_state() -> None:
    device = device_with(*AZ3_PDOS, operational=False)
    tpdos = ["185#370618FC19000100", "285#3706FEFFFFFF0000", "385#3706A86100000000", "485#3706FBFF0000"]
    for command, sdo, pdo in (("80", True, False), ("01", True, True), ("02", False, False), ("80", True, False)):
        feed(device, f"000#{command}05")
        assert feed(device, READ_STATUS) == ([STATUS] if sdo else [])
        assert feed(device, "080#") == (tpdos if pdo else [])
        assert len(device.error(0x2310, 0.0, source=command)) == sdo
        device.errors.reset(communication_only=False)


def test_a_command_to_another_node_changes_nothing() -> None:
    device = device_with(operational=False)
    states = []
    for node in ("06", "00"):
        feed(device, f"000#01{node}")
        states.append(device.state)
    assert states == [NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL]


def test_heartbeat_follows_1017h_and_the_state() -> None:
    device = device_with(operational=False)
    assert feed(device, "605#2B171000E8030000", 1.0) == ["585#6017100000000000", "705#7F"]
    assert device.deadline == 2.0
    assert feed(device, "000#0205", 1.5) == []
    assert feed(device, None, 2.0) == ["705#04"]
    assert feed(device, "000#0105", 2.5) == []
    assert feed(device, None, 3.0) == ["705#05"]


def test_reset_communication_restores_the_communication_only() -> None:
    reset: list[NmtCommand] = []
    device = LocalNode(5, az3_objects(), on_reset=reset.append)
    device.start(0.0)
    feed(device, "605#2B171000E8030000")
    feed(device, "605#2B4060000F000000")
    assert feed(device, "000#8205", 1.0) == ["705#00"]
    assert (device.objects.get(0x1017), device.objects.get(0x6040)) == (0, 15)
    assert device.deadline is None
    assert feed(device, "000#8100", 2.0) == ["705#00"]
    assert device.objects.get(0x6040) == 0
    assert reset == [NmtCommand.RESET_COMMUNICATION, NmtCommand.RESET_NODE]
    assert device.state is NmtState.PRE_OPERATIONAL


def test_a_default_heartbeat_time_is_kept_after_a_reset() -> None:
    device = LocalNode(5, ObjectDictionary([Entry(0x1017, 0, "heartbeat time", "u16", "rw", 1000)]))
    device.start(0.0)
    assert feed(device, None, 1.0) == ["705#7F"]
    assert feed(device, "000#8205", 1.5) == ["705#00"]
    assert device.deadline == 2.5


def test_rpdos_of_type_0_take_effect_at_sync() -> None:
    device = device_with(*AZ3_PDOS)
    feed(device, "205#0F00589EFFFF")
    assert device.objects.get(0x60FF) == 0
    feed(device, "405#0F000000C03F")
    feed(device, "505#0F00FBFF")
    feed(device, "080#")
    objects = device.objects
    assert [objects.get(0x6040), objects.get(0x60FF), objects.get(0x206A, 1), objects.get(0x6071)] == [
        15,
        -25000,
        1.5,
        -5,
    ]


def test_held_rpdo_data_is_discarded_with_the_state() -> None:
    device = device_with(*AZ3_PDOS)
    feed(device, "205#0F00589EFFFF")
    feed(device, "000#8005")
    feed(device, "000#0105")
    feed(device, "080#")
    assert device.objects.get(0x60FF) == 0


def test_rpdos_of_type_255_take_effect_at_once_and_call_hooks() -> None:
    written: list[Value] = []
    objects = ObjectDictionary([Entry(0x6040, 0, "controlword", "u16", "rw", 0, maximum=100, on_write=written.append)])
    device = LocalNode(5, objects, [PdoConfig("RPDO", 1, (0x60400010,))])
    device.start(0.0)
    feed(device, "000#0105")
    feed(device, "205#0F00")
    feed(device, "205#FF00")  # too high: refused, and counted
    assert (written, device.pdo.refused, objects.get(0x6040)) == ([15], 1, 15)


def test_a_wrong_length_of_an_rpdo_is_reported_once() -> None:
    device = device_with(PdoConfig("RPDO", 1, (0x60400010,)))
    assert feed(device, "205#0F") == ["085#1082110102000000"]
    assert feed(device, "205#0E") == []
    assert (device.objects.get(0x6040), device.objects.get(0x1001)) == (0, 0x11)
    assert feed(device, "205#0F0001") == ["085#2082110302000000", "085#0000110000000000"]
    assert device.objects.get(0x6040) == 15
    assert feed(device, "205#0700") == ["085#0000000000000000"]
    assert feed(device, "205#") == ["085#1082110002000000"]


def test_tpdo_at_every_third_sync() -> None:
    device = device_with(PdoConfig("TPDO", 1, (0x60410010,), type=3))
    assert [feed(device, "080#") for _ in range(6)] == [[], [], ["185#3706"], [], [], ["185#3706"]]


def test_tpdo_waits_for_its_sync_start_value() -> None:
    device = device_with(PdoConfig("TPDO", 1, (0x60410010,), type=2, sync_start=3))
    sent = [len(feed(device, f"080#{counter:02X}")) for counter in (1, 2, 3, 4, 1, 2)]
    assert sent == [0, 0, 0, 1, 0, 1]


def test_acyclic_tpdo_is_sent_at_sync_if_something_changed() -> None:
    device = device_with(PdoConfig("TPDO", 1, (0x60410010,), type=0))
    assert feed(device, "080#") == ["185#3706"]
    assert feed(device, "080#") == []
    device.objects.set(0x6041, 0, 0x0231)
    assert feed(device, None) == []
    assert feed(device, "080#") == ["185#3102"]


def test_event_driven_tpdo_with_inhibit_time_and_event_timer() -> None:
    pdo = PdoConfig("TPDO", 1, (0x60410010,), type=255, inhibit=1000, event_timer=500)
    device = device_with(pdo, operational=False)
    assert feed(device, "000#0105", 10.0) == ["185#3706"]
    assert device.deadline == 10.5
    device.objects.set(0x6041, 0, 0x0231)
    assert device.deadline == pytest.approx(10.1)
    assert feed(device, None, 10.05) == []
    assert feed(device, None, 10.1) == ["185#3102"]
    assert feed(device, None, 10.5) == []
    assert feed(device, None, 10.6) == ["185#3102"]


def test_a_value_that_does_not_fit_its_bits_is_counted() -> None:
    device = device_with(PdoConfig("TPDO", 1, (0x60410008,), type=1))
    assert feed(device, "080#") == ["185#00"]
    assert device.pdo.refused


def answer(device: LocalNode, request: str) -> str:
    """Return the response to an SDO request: 'ok' for a confirmation, the abort code in reading order, or the value."""
    data = CanFrame.parse(feed(device, f"605#{request.replace(' ', '')}")[0]).data
    number = int.from_bytes(data[4:], "little")
    return {0x60: "ok", 0x80: f"{number:08X}"}.get(data[0], f"{number:X}")


def test_pdo_records_are_in_the_dictionary() -> None:
    device = device_with(*AZ3_PDOS, operational=False)
    assert answer(device, "40 00 14 01 00 00 00 00") == "205"
    assert answer(device, "40 00 18 02 00 00 00 00") == "1"
    assert answer(device, "40 02 16 00 00 00 00 00") == "2"
    assert answer(device, "40 02 16 02 00 00 00 00") == "206A0120"
    assert answer(device, "40 00 1A 04 00 00 00 00") == "20060010"


def test_a_mapping_is_changed_in_the_order_of_the_standard() -> None:
    device = device_with(*AZ3_PDOS, operational=False)
    steps = [
        "23 00 18 01 85 01 00 80",  # off
        "2F 00 1A 00 00 00 00 00",
        "23 00 1A 01 20 00 64 60",
        "23 00 1A 02 10 00 41 60",
        "2F 00 1A 00 02 00 00 00",
        "2F 00 18 02 01 00 00 00",
        "2B 00 18 03 64 00 00 00",
        "23 00 18 01 95 01 00 00",  # on, with another identifier
    ]
    assert [answer(device, step) for step in steps] == ["ok"] * len(steps)
    feed(device, "000#0105")
    assert feed(device, "080#")[0] == "195#FEFFFFFF3706"


@pytest.mark.parametrize(
    ("request_", "code"),
    [
        ("2F 00 1A 00 00 00 00 00", "06010000"),  # mapping while switched on
        ("23 00 1A 01 20 00 64 60", "06010000"),
        ("23 00 18 01 95 01 00 00", "06090030"),  # another identifier while switched on
        ("2B 00 18 03 64 00 00 00", "06090030"),  # inhibit time while switched on
        ("2F 00 18 02 FB 00 00 00", "06090030"),  # type 251, reserved
        ("2F 00 14 02 FC 00 00 00", "06090030"),  # type 252, for TPDOs only
        ("2F 00 18 00 05 00 00 00", "06010002"),
    ],
)
def test_writes_refused_while_the_pdo_is_on(request_: str, code: str) -> None:
    assert answer(device_with(*AZ3_PDOS, operational=False), request_) == code


@pytest.mark.parametrize(
    ("request_", "code"),
    [
        ("23 00 16 01 10 00 FF 2F", "06040041"),  # no such object
        ("23 00 16 01 10 00 41 60", "06040041"),  # an RPDO cannot write the statusword
        ("23 00 16 01 08 00 6A 20", "06040041"),  # a float of 8 bits
        ("23 00 16 01 08 00 05 00", "ok"),  # a dummy
        ("23 00 16 09 10 00 40 60", "06090011"),
        ("2F 00 16 00 09 00 00 00", "06040042"),
        ("2F 00 16 00 03 00 00 00", "06040042"),  # 16 + 32 + 32 bits
        ("23 00 14 01 05 06 00 00", "06090030"),  # the identifier of an SDO
    ],
)
def test_mappings_that_are_refused(request_: str, code: str) -> None:
    device = device_with(PdoConfig("RPDO", 1, (0x60400010, 0x60FF0020, 0x607A0010)), operational=False)
    assert answer(device, "23 00 14 01 05 02 00 80") == "ok"
    if request_.startswith("23 00 16"):
        assert answer(device, "2F 00 16 00 00 00 00 00") == "ok"
    if request_ == "2F 00 16 00 03 00 00 00":
        assert answer(device, "2F 00 16 00 00 00 00 00") == "ok"
        assert answer(device, "23 00 16 03 20 00 7A 60") == "ok"
    assert answer(device, request_) == code


def test_invalid_factory_settings_raise() -> None:
    with pytest.raises(EncodeError, match="no such object"):
        LocalNode(5, ObjectDictionary(), [PdoConfig("TPDO", 1, (0x60410010,))])
    with pytest.raises(EncodeError, match="expected a number"):
        LocalNode(5, az3_objects(), [PdoConfig("TPDO", 0, (0x60410010,))])
    with pytest.raises(EncodeError, match="defined twice"):
        LocalNode(5, az3_objects(), [PdoConfig("TPDO", 1, ()), PdoConfig("TPDO", 1, ())])


def test_a_list_of_entries_is_not_a_dictionary() -> None:
    for wrong in ("5", 5.0, True, 0, 128):
        with pytest.raises(EncodeError, match=rf"^node {wrong!r}: expected 1..127$"):
            LocalNode(wrong, ObjectDictionary())  # type: ignore[arg-type]
    for pdos in (5, [5]):
        with pytest.raises(EncodeError, match=r"^LocalNode: pdos = \[?5\]?: expected several PdoConfig, such as "):
            LocalNode(5, ObjectDictionary(), pdos)  # type: ignore[arg-type]
    with pytest.raises(EncodeError, match=r"expected an ObjectDictionary, such as ObjectDictionary\(\[Entry"):
        LocalNode(5, [Entry(0x6040, 0, "controlword", "u16")])  # type: ignore[arg-type]


def test_existing_pdo_records_keep_their_names() -> None:
    objects = az3_objects()
    objects.add(Entry(0x1800, 1, "TPDO1 COB-ID", "u32", "rw", 0x181))
    objects.add(Entry(0x1800, 4, "TPDO1 COMPATIBILITY ENTRY", "u8", "rw", 0))
    objects.add(Entry(0x1A00, 0, "highest sub-index supported", "u8", "const", 1))
    device = LocalNode(5, objects, [PdoConfig("TPDO", 1, (0x60410010,), type=1)])
    device.start(0.0)
    assert objects.entry(0x1800, 1).name == "TPDO1 COB-ID"
    assert answer(device, "40 00 18 01 00 00 00 00") == "185"
    assert answer(device, "40 00 18 04 00 00 00 00") == "0"
    assert answer(device, "23 00 18 01 85 01 00 80") == "ok"
    assert answer(device, "2F 00 1A 00 00 00 00 00") == "ok"


def test_a_fifth_pdo_is_off_until_it_has_an_identifier() -> None:
    device = device_with(PdoConfig("TPDO", 5, (0x60410010,), type=1), operational=False)
    assert answer(device, "40 04 18 01 00 00 00 00") == "80000000"
    assert answer(device, "23 04 18 01 A0 06 00 00") == "ok"
    feed(device, "000#0105")
    assert feed(device, "080#") == ["6A0#3706"]


def in_a_block(*pdos: PdoConfig) -> LocalNode:
    """Return a device in the middle of a block download."""
    objects = ObjectDictionary([*az3_objects(), Entry(0x2F00, 0, "long", "domain", "rw", b"")])
    device = LocalNode(5, objects, pdos)
    device.start(0.0)
    for text in ("000#0105", "605#C6002F0010270000"):
        device.feed(CanFrame.parse(text), 0.0)
    return device


def test_all_other_services_continue_inside_a_block() -> None:
    device = in_a_block(PdoConfig("TPDO", 1, (0x60410010,)))

    def segment(number: int, now: float) -> list[str]:
        return feed(device, f"605#{number:02X}00000000000000", now)

    assert [segment(number, 0.01) for number in (1, 2, 3)] == [[], [], []]
    device.objects.set(0x6041, 0, 0x1237)
    assert segment(4, 0.02) == ["185#3712"]
    device.objects.set(0x1017, 0, 100)
    sent = [text for step in range(40) for text in segment(5 + step, 0.1 + step / 100)]
    assert sent == ["705#05"] * 4
    assert [str(frame) for frame in device.error(0x4210, 0.49)] == ["085#1042090000000000"]
    assert device.sdo.counters.requests == 45
    assert segment(45, 0.5) == ["705#05"]
    assert device.feed(CanFrame.parse("000#0205"), 0.51) == []
    assert device.sdo.deadline is None  # STOPPED ends the transfer
    assert device.feed(CanFrame.parse("605#2D00000000000000"), 0.52) == []


def test_a_computed_object_is_read_each_time() -> None:
    times = [0]
    device = device_with()
    device.objects.replace(Entry(0x1017, 0, "heartbeat time", "u16", "rw", on_read=lambda: times[0]))
    device.feed(None, 1.0)
    times[0] = 500
    assert [str(frame) for frame in device.feed(None, 2.0)] == ["705#05"]
    assert device.deadline == 2.5


def test_a_monitored_node_that_boots_is_an_error_until_its_next_heartbeat() -> None:
    device = LocalNode(5, ObjectDictionary([*standard_objects(watched=1)]))
    device.start(0.0)
    feed(device, "605#23161001E8030700")  # node 7 at least every second
    assert feed(device, "000#0105", 0.1) == []
    assert feed(device, "707#05", 0.2) == []
    assert feed(device, "707#00", 0.3) == ["085#3081110700000000"], "its boot-up message: emergency 8130h"
    assert device.state is NmtState.PRE_OPERATIONAL, "1029h is 0"
    assert feed(device, None, 9.0) == [], "said once"
    assert feed(device, "707#7F", 9.1) == ["085#0000000700000000"], "the next heartbeat"


def test_the_boot_up_of_a_node_that_is_not_monitored_is_no_error() -> None:
    device = LocalNode(5, ObjectDictionary([*standard_objects(watched=1)]))
    device.start(0.0)
    feed(device, "605#23161001E8030700")  # node 7 is in 1016h, node 6 is not
    feed(device, "000#0105", 0.1)
    for frame in ("706#05", "706#00", "706#7F"):
        assert feed(device, frame, 0.2) == []
    assert device.state is NmtState.OPERATIONAL
