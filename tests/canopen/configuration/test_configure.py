"""Comparing a device with its DCF, and writing what differs, with a local node in virtual time."""

from __future__ import annotations

import pytest

from barewire.canopen import (
    ConfigurationFailed,
    DeviceConfiguration,
    SdoAbort,
    Setting,
    compare_device,
    configure_device,
    device_configuration,
    eds,
)
from barewire.errors import EncodeError, NoAnswer
from tests.canopen.configuration.plant import DATE, bus_with, dcf, described, writes

STAMP = ["1020:1=3C9F", "1020:2=3059EE0"]


def test_only_differences_are_written_and_a_second_run_writes_nothing() -> None:
    bus, device = bus_with()
    wanted = device_configuration(dcf({"Heartbeat": 500, "Cycle": 0, "Label": "pump"}))
    result = bus.run(configure_device(5, wanted))
    assert [str(change) for change in result.changes[:2]] == [
        "1017h:00 Heartbeat: device 0, configuration 500",
        "2001h:00 Label: device '', configuration 'pump'",
    ]
    assert (device.objects["Heartbeat"], device.objects["Label"]) == (500, "pump")
    assert writes(bus) == ["1017:0=1F4", "2001:0=706D7570", *STAMP]
    bus.log.clear()
    assert bus.run(configure_device(5, wanted)).changes == ()
    assert writes(bus) == []


def test_pdos_are_off_while_anything_changes() -> None:
    bus, _ = bus_with()
    values: dict[tuple[int, int] | str, int] = {
        (0x1800, 1): 0x185, (0x1800, 2): 1, (0x1A00, 0): 2, (0x1A00, 1): 0x60640020, (0x1A00, 2): 0x60410010,
        (0x1801, 1): 0x80000285, (0x1400, 1): 0x205, "Heartbeat": 500,
    }  # fmt: skip
    bus.run(configure_device(5, device_configuration(dcf(dict(values)))))
    assert writes(bus) == [
        *("1800:1=80000185", "1801:1=80000285", "1017:0=1F4"),
        *("1A00:0=0", "1A00:1=60640020", "1A00:2=60410010", "1A00:0=2", "1800:2=1", "1800:1=185"),
        *STAMP,
    ]
    bus.inject("000#0105", bus.now)
    bus.inject("080#", bus.now)
    assert "185#FEFFFFFF3700" in bus.pass_time(0.1)


def test_mapping_entries_that_the_dcf_does_not_state_stay() -> None:
    bus, device = bus_with()
    bus.run(configure_device(5, device_configuration(dcf({(0x1A00, 0): 2, (0x1A00, 2): 0x60640020}))))
    assert [device.objects[0x1A00, sub] for sub in (0, 1, 2)] == [2, 0x60410010, 0x60640020]
    bus, _ = bus_with()
    with pytest.raises(EncodeError, match=r"TPDO1 maps 3 objects: expected a value for 1A00h:02"):
        bus.run(configure_device(5, device_configuration(dcf({(0x1A00, 0): 3, (0x1A00, 3): 0x60640020}))))
    assert writes(bus) == []


def test_objects_that_cannot_change_in_one_write() -> None:
    present = {"x1005_00": 0x4000_0080, "x1006_00": 1000, "x1016_01": 0x203E8, "x1016_02": 0x303E8}
    bus, _ = bus_with(**present)
    changed: dict[tuple[int, int] | str, int] = {
        "COB-ID SYNC": 0x4000_0081, "Overflow": 10, (0x1016, 1): 0x303E8, (0x1016, 2): 0x203E8, "COB-ID EMCY": 0x91
    }  # fmt: skip
    bus.run(configure_device(5, device_configuration(dcf(dict(changed)))))
    assert writes(bus)[:-2] == [
        *("1016:1=0", "1016:2=0", "1006:0=0", "1005:0=80", "1005:0=40000081", "1014:0=80000085", "1014:0=91"),
        *("1016:1=303E8", "1016:2=203E8", "1019:0=A", "1006:0=3E8"),
    ]


def test_a_write_only_object_is_always_written_and_never_read() -> None:
    bus, device = bus_with(x1020_01=DATE["Configuration.Date"], x1020_02=DATE["Configuration.Time"])
    wanted = device_configuration(dcf({"Password": 77}))
    assert [repr(change) for change in bus.run(compare_device(5, wanted))] == [
        "<Difference 2000h:00 Password: device write-only, configuration 77>"
    ]
    bus.run(configure_device(5, wanted))
    assert writes(bus) == ["1020:1=0", "2000:0=4D", *STAMP]  # the date is away while the values are not there
    assert device.objects["Password"] == 77


def test_another_device_is_not_configured() -> None:
    bus, _ = bus_with(x1018_02=8)
    with pytest.raises(ConfigurationFailed) as error:
        bus.run(configure_device(5, device_configuration(dcf({"Heartbeat": 500}))))
    text = "1018h:02 Identity.Product: device 00000008h, configuration 00000007h"
    assert str(error.value) == f"node 5 is another device: {text}"
    assert writes(bus) == []


def test_a_dry_run_writes_nothing_and_has_the_same_errors() -> None:
    bus, device = bus_with()
    wanted = device_configuration(dcf({"Heartbeat": 500}))
    result = bus.run(configure_device(5, wanted, dry_run=True, store=True))
    assert [change.entry.index for change in result.changes] == [0x1017, 0x1020, 0x1020]
    assert (result.stored, writes(bus)) == (False, [])
    device.objects.set(0x1018, 1, 1)
    with pytest.raises(ConfigurationFailed, match="another device"):
        bus.run(configure_device(5, wanted, dry_run=True))


def test_the_serial_number_counts_if_the_dcf_has_that_of_one_device() -> None:
    document = dcf({"Heartbeat": 0})
    document.put("DeviceComissioning", "LSS_SerialNumber", "100")
    bus, _ = bus_with()
    with pytest.raises(ConfigurationFailed, match=r"1018h:04 Identity\.Serial"):
        bus.run(configure_device(5, device_configuration(document)))
    document.put("DeviceComissioning", "LSS_SerialNumber", "99")
    bus.run(configure_device(5, device_configuration(document)))


def test_an_object_that_the_device_does_not_have_is_found_before_anything_is_written() -> None:
    extended = described()
    eds.add_object(extended, OTHER)
    document = eds.to_dcf(extended, 5, {"Heartbeat": 5, "Extra": 1})
    bus, _ = bus_with()
    with pytest.raises(ConfigurationFailed, match="nothing was written: 2500h:00 Extra: device no such object"):
        bus.run(configure_device(5, device_configuration(document)))
    assert writes(bus) == []


OTHER = eds.EdsObject(0x2500, "Extra", 7, (eds.EdsItem(0, "Extra", "u8"),))


def test_a_refused_value_leaves_pdos_off_and_the_date_away() -> None:
    bus, device = bus_with()
    wanted = device_configuration(dcf({(0x1800, 1): 0x185, (0x1800, 2): 5, (0x1A00, 1): 0x60400010 + 0x10000000}))
    with pytest.raises(SdoAbort) as error:
        bus.run(configure_device(5, wanted))
    assert error.value.__notes__[-1] == (
        "node 5 has 1 object written, and these PDOs switched off: TPDO1, and not the date of the configuration; "
        "configure it again"
    )
    assert (device.objects[0x1800, 1], device.objects[0x1020, 1]) == (0x80000185, 0)


def test_a_value_that_the_device_changes_is_reported() -> None:
    bus, device = bus_with()
    device.objects.hook("Heartbeat", on_read=lambda: 510)
    with pytest.raises(ConfigurationFailed, match="other values than were written: 1017h:00 Heartbeat: device 510"):
        bus.run(configure_device(5, device_configuration(dcf({"Heartbeat": 500}))))
    assert device.objects[0x1020, 1] == 0


def test_the_device_stores_its_parameters_only_if_asked() -> None:
    bus, device = bus_with()
    wanted = device_configuration(dcf({"Heartbeat": 500}))
    assert not bus.run(configure_device(5, wanted)).stored
    assert device.stored.values == {}
    assert bus.run(configure_device(5, wanted, store=True)).stored
    assert device.stored.values[0x1017, 0] == 500
    assert device.stored.values[0x1020, 1] == DATE["Configuration.Date"]


def test_progress_is_told_before_each_step() -> None:
    bus, _ = bus_with()
    steps: list[tuple[int, int, str]] = []
    bus.run(
        configure_device(
            5, device_configuration(dcf({"Heartbeat": 500})), store=True, progress=lambda *step: steps.append(step)
        )
    )
    assert [done for done, _, _ in steps] == list(range(len(steps)))
    assert all(done < total for done, total, _ in steps)
    assert [step for _, _, step in steps if "1017h" in step] == [
        *("read 1017h:00 Heartbeat", "write 1017h:00 Heartbeat = 500", "read back 1017h:00 Heartbeat"),
    ]
    assert steps[-1][2] == "store: 1010h:01"


def test_no_device() -> None:
    bus, _ = bus_with(6)
    with pytest.raises(NoAnswer):
        bus.run(configure_device(5, device_configuration(dcf({"Heartbeat": 500}))))


PRESENT_DATE = {"x1020_01": DATE["Configuration.Date"], "x1020_02": DATE["Configuration.Time"]}


@pytest.mark.parametrize(
    ("second", "text"),
    [
        ({(0x1801, 1): 0x285, (0x1A01, 0): 3, (0x1A01, 3): 0x60640020}, "TPDO2 maps 3 objects: .* for 1A01h:02"),
        ({(0x1A01, 0): 2, (0x1A01, 2): 0x60640040}, "TPDO2: 1A01h maps 80 bits: expected at most 64"),
    ],
    ids=["an entry is missing", "more than 64 bits with the present entry"],
)
@pytest.mark.parametrize("dry_run", [False, True])
def test_a_mapping_that_is_not_possible_is_found_before_anything_is_written(
    second: dict[tuple[int, int] | str, int], text: str, dry_run: bool
) -> None:
    wanted = device_configuration(dcf({"Heartbeat": 500, (0x1800, 2): 1, **second}))
    bus, _ = bus_with(**PRESENT_DATE)
    with pytest.raises(EncodeError, match=text) as error:
        bus.run(configure_device(5, wanted, dry_run=dry_run))
    assert writes(bus) == []
    assert getattr(error.value, "__notes__", []) == ([] if dry_run else ["nothing was written to node 5"])


def test_an_entry_beyond_the_number_is_found_before_anything_is_written() -> None:
    entry = described().dictionary(5).entry
    wanted = DeviceConfiguration(5, (Setting(entry(0x1800, 2), 1), Setting(entry(0x1A00, 2), 0x60640020)))
    bus, _ = bus_with()
    with pytest.raises(EncodeError, match=r"TPDO1 maps 1 objects, but 1A00h:02 is configured: expected .* 1A00h:00"):
        bus.run(configure_device(5, wanted))
    assert writes(bus) == []


@pytest.mark.parametrize("dry_run", [False, True])
def test_a_lost_response_to_a_read_says_that_nothing_was_written(dry_run: bool) -> None:
    bus, _ = bus_with()
    bus.lose = lambda number, frame: frame.id == 0x585 and frame.data[1:3] == b"\x17\x10"
    with pytest.raises(NoAnswer) as error:
        bus.run(configure_device(5, device_configuration(dcf({"Heartbeat": 500})), dry_run=dry_run))
    assert getattr(error.value, "__notes__", []) == ([] if dry_run else ["nothing was written to node 5"])
    assert writes(bus) == []


@pytest.mark.parametrize(
    ("lost", "values", "store", "note"),
    [
        (
            b"\x60\x17\x10",
            {"Heartbeat": 500, "Cycle": 1000},
            False,
            "node 5 has 1 object written (and perhaps 1017h:00, whose response did not come), "
            "and not the date of the configuration; configure it again",
        ),
        (
            b"\x60",
            {(0x1800, 2): 1},
            False,
            "node 5 has no object written (and perhaps 1800h:01, whose response did not come), "
            "and not the date of the configuration; configure it again",
        ),
        (
            b"\x60\x10\x10",
            {"Heartbeat": 500},
            True,
            "node 5 has all values of the configuration, and may have stored them or not",
        ),
    ],
    ids=["to a write", "to the first write", "to store"],
)
def test_a_lost_response_says_what_may_be_written(
    lost: bytes, values: dict[tuple[int, int] | str, int], store: bool, note: str
) -> None:
    bus, device = bus_with()
    bus.lose = lambda number, frame: frame.id == 0x585 and frame.data.startswith(lost)
    with pytest.raises(NoAnswer) as error:
        bus.run(configure_device(5, device_configuration(dcf({**values})), store=store))
    assert error.value.__notes__ == [note]
    assert device.objects["Heartbeat"] == values.get("Heartbeat", 0)  # it was written
