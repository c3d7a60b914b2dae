"""The concise DCF: bytes, lists of values, DCF files, and the order of its writes."""

from __future__ import annotations

import pytest

from barewire.canopen import (
    ConciseValue,
    DeviceConfiguration,
    Entry,
    Setting,
    concise_dcf,
    concise_values,
    decode_concise_dcf,
    device_configuration,
    download,
    eds,
    encode_concise_dcf,
)
from barewire.errors import DecodeError, EncodeError
from tests.canopen.configuration.plant import bus_with, dcf, described

CASES = {
    "00000000": [],
    "01000000 1710 00 02000000 F401": [ConciseValue(0x1017, 0, b"\xf4\x01")],
    "02000000 0018 01 04000000 85010080 0120 00 00000000": [
        ConciseValue(0x1800, 1, bytes.fromhex("85010080")), ConciseValue(0x2001, 0, b"")
    ],
    "01000000 FFFF FF 09000000 70756D70206E6F2031": [ConciseValue(0xFFFF, 0xFF, b"pump no 1")],
}  # fmt: skip


@pytest.mark.parametrize("text", CASES)
def test_bytes_and_values(text: str) -> None:
    data = bytes.fromhex(text)
    assert decode_concise_dcf(data) == CASES[text]
    assert encode_concise_dcf(CASES[text]) == data


def test_no_bytes_are_no_values() -> None:
    assert decode_concise_dcf(b"") == []


@pytest.mark.parametrize(
    ("text", "reason", "at", "words"),
    [
        ("010000", "short", 3, "the number of values takes 4 bytes"),
        ("01000000", "short", 4, "index, sub-index and size of value 1 of 1"),
        ("01000000 1710 00 020000", "short", 10, "index, sub-index and size of value 1 of 1"),
        ("01000000 1710 00 02000000 F4", "short", 12, "1017h:00, value 1 of 1, has 2 bytes: 1 are there"),
        ("02000000 1710 00 01000000 F4", "short", 12, "size of value 2 of 2"),
        ("01000000 1710 00 FFFFFFFF F401", "short", 13, "has 4294967295 bytes: 2 are there"),
        ("FFFFFFFF 1710 00 02000000 F401", "short", 13, "value 2 of 4294967295"),
        ("01000000 1710 00 01000000 F401", "long", 12, "1 bytes after the last of 1 values"),
        ("00000000 00", "long", 4, "1 bytes after the last of 0 values"),
    ],
)
def test_bytes_that_are_not_a_concise_dcf(text: str, reason: str, at: int, words: str) -> None:
    with pytest.raises(DecodeError, match=words) as error:
        decode_concise_dcf(bytes.fromhex(text))
    assert (error.value.reason, error.value.at) == (reason, at)


def test_values_that_do_not_exist() -> None:
    for index, sub in ((0x10000, 0), (-1, 0), (0, 256)):
        with pytest.raises(EncodeError, match="expected 0"):
            encode_concise_dcf([ConciseValue(index, sub, b"")])


def test_the_order_is_safe_for_any_device_and_leads_to_the_dcf() -> None:
    document = dcf(
        {
            "Heartbeat": 500,
            "Cycle": 1000,
            "Overflow": 10,
            "Label": "pump",
            (0x1016, 1): 0x203E8,
            (0x1016, 2): 0x303E8,
            (0x1800, 1): 0x185,
            (0x1800, 2): 1,
            (0x1A00, 0): 2,
            (0x1A00, 1): 0x60640020,
            (0x1A00, 2): 0x60410010,
            (0x1801, 1): 0x80000285,
        }
    )
    values = concise_dcf(device_configuration(document))
    assert [f"{value.index:X}:{value.sub}={int.from_bytes(value.data, 'little'):X}" for value in values] == [
        *("1800:1=80000185", "1801:1=80000285"),
        *("1016:1=0", "1016:2=0", "1006:0=0", "1016:1=203E8", "1016:2=303E8", "1017:0=1F4", "2001:0=706D7570"),
        *("1019:0=A", "1006:0=3E8"),
        *("1A00:0=0", "1A00:1=60640020", "1A00:2=60410010", "1A00:0=2", "1800:2=1", "1800:1=185"),
        *("1020:1=3C9F", "1020:2=3059EE0"),
    ]
    bus, device = bus_with(x1006_00=5, x1016_01=0x303E8)
    for value in decode_concise_dcf(encode_concise_dcf(values)):
        bus.run(download(5, value.index, value.sub, value.data))
    assert [device.objects[0x1A00, sub] for sub in range(3)] == [2, 0x60640020, 0x60410010]
    assert (device.objects["Overflow"], device.objects["Cycle"], device.objects["Label"]) == (10, 1000, "pump")
    back = eds.to_dcf(described(), 5, concise_values(values, device.objects))
    assert device_configuration(back).settings == device_configuration(document).settings


def test_a_counter_without_a_cycle_leaves_the_cycle_as_it_is() -> None:
    values = concise_dcf(device_configuration(dcf({"Overflow": 10})))
    assert [value.index for value in values] == [0x1019, 0x1020, 0x1020]


def test_a_mapping_needs_the_cob_id_of_its_pdo() -> None:
    with pytest.raises(EncodeError, match=r"TPDO1: its mapping is configured, but not its COB-ID: .* of 1800h:01"):
        concise_dcf(device_configuration(dcf({(0x1A00, 0): 0})))


def test_values_that_do_not_fit_the_dictionary() -> None:
    objects = described().dictionary(5)
    with pytest.raises(EncodeError, match="no object 5000h:00"):
        concise_values([ConciseValue(0x5000, 0, b"")], objects)
    with pytest.raises(DecodeError, match="<ConciseValue 1017h:00 = 01> is to be Heartbeat, u16"):
        concise_values([ConciseValue(0x1017, 0, b"\1")], objects)


def test_entries_of_a_mapping_are_written_while_their_number_is_zero() -> None:
    values = concise_dcf(device_configuration(dcf({(0x1800, 1): 0x185, (0x1A00, 1): 0x60640020})))
    assert [f"{value.index:X}:{value.sub}={value.data[0]:X}" for value in values if value.index == 0x1A00] == [
        *("1A00:0=0", "1A00:1=20", "1A00:0=1"),
    ]
    bus, device = bus_with()
    for value in values:
        bus.run(download(5, value.index, value.sub, value.data))
    assert device.objects[0x1A00, 1] == 0x60640020


def test_entries_of_a_mapping_need_their_number() -> None:
    entry = described().dictionary(5).entry
    settings = Setting(entry(0x1800, 1), 0x185), Setting(entry(0x1A00, 1), 0x60640020)
    with pytest.raises(EncodeError, match=r"TPDO1: its mapping is .*, but not its number .* of 1A00h:00"):
        concise_dcf(DeviceConfiguration(5, settings))


def counted(value: int, default: int) -> DeviceConfiguration:
    number = Entry(0x1016, 0, "highest", "u8", default=default, object_name="Consumer")
    return DeviceConfiguration(5, (Setting(number, value), Setting(Entry(0x1016, 1, "one", "u32"), 0x203E8)))


def test_the_number_of_entries_of_an_array_is_written_only_where_it_changes() -> None:
    assert [value.sub for value in concise_dcf(counted(2, default=2))] == [1]
    assert [value.sub for value in concise_dcf(counted(1, default=2))] == [0, 1]
    alone = DeviceConfiguration(5, (Setting(Entry(0x1017, 0, "heartbeat", "u16", default=7), 7),))
    assert len(concise_dcf(alone)) == 1  # a variable
