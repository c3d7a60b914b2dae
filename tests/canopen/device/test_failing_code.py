"""A device whose own code raises errors: with `on_failure` it reports them, and all its services work on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from barewire.canopen import (
    CobEntry,
    Entry,
    LocalNode,
    LssAddress,
    LssSlave,
    NmtCommand,
    NmtState,
    ObjectDictionary,
    PdoConfig,
)
from barewire.canopen.communication_objects import standard_objects
from barewire.canopen.device.services import AdditionalServers, DeviceConsumers, ErrorControl
from barewire.canopen.pdo.engine import PdoEngine
from barewire.canopen.sdo.server import SdoServer
from barewire.codecs import Value
from barewire.devices.sim import simulator
from tests.canopen.device.test_device import feed
from tests.helpers import every_case

INTERNAL_SOFTWARE = "085#0061010000000000"


class Application:
    """The code of a device with objects that fail as long as `broken`."""

    def __init__(self) -> None:
        self.broken = True
        self.failures: list[str] = []
        self.objects = ObjectDictionary(
            [
                *standard_objects(heartbeat=1000, servers=2),
                Entry(0x2001, 0, "sensor", "u16", "ro", on_read=self.sensor),
                Entry(0x2002, 0, "motor", "u16", "rw", on_write=self.motor),
                Entry(0x2003, 0, "text", "string", "rw", "", on_write=self.motor),
                Entry(0x2004, 0, "good", "u16", "rw", 7),
            ]
        )

    def sensor(self) -> Value:
        if self.broken:
            raise ValueError("no sensor")
        return 5

    def motor(self, value: Value) -> None:
        if self.broken:
            raise OSError("no motor")

    def report(self, place: str, error: Exception) -> None:
        self.failures.append(f"{place}: {type(error).__name__}: {error}")

    def device(self, *pdos: PdoConfig, on_reset: Callable[[NmtCommand], None] | None = None) -> LocalNode:
        device = LocalNode(5, self.objects, pdos, on_reset=on_reset, on_failure=self.report)
        device.start(0.0)
        return device


def test_without_on_failure_the_error_is_raised() -> None:
    device = LocalNode(5, Application().objects)
    device.start(0.0)
    with pytest.raises(ValueError, match="no sensor"):
        feed(device, "605#4001200000000000")


@pytest.mark.parametrize(
    ("requests", "failure"),
    [
        (["605#4001200000000000"], "2001h:00: ValueError: no sensor"),
        (["605#A001200007000000"], "2001h:00: ValueError: no sensor"),
        (["605#2B02200001000000"], "2002h:00: OSError: no motor"),
        (["605#2103200005000000", "605#0568656C6C6F0000"], "2003h:00: OSError: no motor"),
        (
            ["605#C203200005000000", "605#8168656C6C6F0000", "605#C900000000000000"],
            "2003h:00: OSError: no motor",
        ),
    ],
    ids=["upload", "block upload", "download", "segmented download", "block download"],
)
def test_a_request_whose_code_fails_is_aborted_and_reported(requests: list[str], failure: str) -> None:
    application = Application()
    device = application.device()
    sent = [frame for request in requests for frame in feed(device, request)]
    place = requests[0][6:12]
    assert sent[-2:] == [f"585#80{place}00000008", INTERNAL_SOFTWARE]
    assert application.failures == [failure]
    assert feed(device, "605#4004200000000000") == ["585#4B04200007000000"], "the next request is served"
    assert feed(device, None, 1.0) == ["705#7F"]
    application.broken = False
    assert feed(device, "605#4001200000000000") == ["585#4B01200005000000"]


def test_the_emergency_is_sent_once_until_the_application_clears_it() -> None:
    application = Application()
    device = application.device()
    assert feed(device, "605#4001200000000000")[-1] == INTERNAL_SOFTWARE
    assert feed(device, "605#4001200000000000") == ["585#8001200000000008"]
    assert list(device.errors.active) == [0x6100]
    assert [str(frame) for frame in device.error_gone(0x6100, 1.0)] == ["085#0000000000000000"]
    assert feed(device, "605#4001200000000000")[-1] == INTERNAL_SOFTWARE
    assert feed(device, "000#8105") == ["705#00"]
    assert not device.errors.active
    feed(device, "000#0205")  # stopped: no emergency, but the error register has it
    device.objects.replace(Entry(0x1017, 0, "heartbeat time", "u16", on_read=application.sensor))
    assert feed(device, None, 5.0) == []


def test_an_additional_sdo_channel_answers_too() -> None:
    application = Application()
    for sub, identifier in ((1, 0x6A0), (2, 0x6A1)):
        application.objects.set(0x1201, sub, CobEntry(identifier).pack())
    device = application.device()
    assert feed(device, "6A0#4001200000000000") == ["6A1#8001200000000008", INTERNAL_SOFTWARE]


def test_pdos_with_failing_objects_do_not_disturb_the_others() -> None:
    application = Application()
    rpdo = PdoConfig("RPDO", 1, (0x20020010, 0x20040010), type=255)
    tpdos = PdoConfig("TPDO", 1, (0x20010010,), type=1), PdoConfig("TPDO", 2, (0x20040010,), type=1)
    device = application.device(rpdo, *tpdos)
    feed(device, "000#0105")
    assert feed(device, "205#03000400") == [INTERNAL_SOFTWARE]
    assert device.objects.get(0x2004) == 4
    assert feed(device, "080#") == ["185#0000", "285#0400"], "zeros for a value that cannot be read"
    assert application.failures == ["2002h:00: OSError: no motor", "2001h:00: ValueError: no sensor"]
    assert feed(device, None, 1.0) == ["705#05"]


def test_a_failing_object_in_an_event_driven_tpdo_does_not_keep_the_device_busy() -> None:
    application = Application()
    device = application.device(PdoConfig("TPDO", 1, (0x20010010,), type=255))
    assert feed(device, "000#0105") == ["185#0000", INTERNAL_SOFTWARE]
    assert device.deadline == 1.0, "the heartbeat"


def test_a_value_that_does_not_fit_its_object_is_an_error_of_the_application() -> None:
    application = Application()
    device = application.device(PdoConfig("TPDO", 1, (0x20040010, 0x20010010), type=1))
    device.objects.hook(0x2001, on_read=lambda: 70_000)
    assert feed(device, "605#4001200000000000") == ["585#8001200000000008", INTERNAL_SOFTWARE]
    feed(device, "000#0105")
    assert feed(device, "080#") == ["185#00000000"]
    assert len(application.failures) == 2
    assert application.failures[0].startswith("2001h:00: EncodeError: ")
    assert application.failures[1] == application.failures[0], "by SDO and in the PDO"


def test_a_value_that_does_not_fit_its_pdo_is_reported_once_and_again_after_it_did() -> None:
    """The engine looks at the value at each deadline, to find out whether it changed."""
    application = Application()
    device = application.device(PdoConfig("TPDO", 1, (0x20010010,), type=255))
    measured = [0]
    device.objects.hook(0x2001, on_read=lambda: measured[0])
    for value, reports in ((70_000, 1), (70_001, 2), (5, 2), (70_001, 3)):
        measured[0] = value
        feed(device, "000#0105")
        for _ in range(3):
            assert device.deadline is not None
            assert len(application.failures) == reports
        feed(device, None, 0.0)


def test_a_reset_whose_code_fails_boots() -> None:
    application = Application()

    def on_reset(command: NmtCommand) -> None:
        application.motor(0)

    device = application.device(on_reset=on_reset)
    assert feed(device, "000#8105") == ["705#00", INTERNAL_SOFTWARE]
    assert device.state is NmtState.PRE_OPERATIONAL
    assert application.failures == ["on_reset: OSError: no motor"]


def test_communication_objects_that_cannot_be_read_leave_the_other_services_alone() -> None:
    application = Application()
    device = application.device(PdoConfig("TPDO", 1, (0x20040010,), type=1))
    for index in (0x1001, 0x1005, 0x1012):
        device.objects.hook(index, on_read=application.sensor)
    assert feed(device, "000#0105")
    assert "705#05" in feed(device, None, 1.0)
    assert "585#4B04200007000000" in feed(device, "605#4004200000000000")
    assert "1005h:00: ValueError: no sensor" in application.failures


DEFECTS = [
    (SdoServer, "_serve", "SDO"),
    (AdditionalServers, "feed", "SDO"),
    (AdditionalServers, "follow", "configuration"),
    (ErrorControl, "feed", "error control"),
    (PdoEngine, "feed", "SYNC and PDO"),
    (DeviceConsumers, "feed", "EMCY and TIME"),
]


@pytest.mark.parametrize(("service", "method", "place"), DEFECTS, ids=lambda value: getattr(value, "__name__", value))
def test_a_defect_of_one_service_leaves_the_others_alone(
    service: type, method: str, place: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def defect(*arguments: object) -> None:
        raise RuntimeError("a defect")

    application = Application()
    device = application.device(PdoConfig("TPDO", 1, (0x20040010,), type=1))
    feed(device, "000#0105")
    monkeypatch.setattr(service, method, defect)
    device.objects.set(0x2004, 0, 8)
    answer = "585#8004200000000008" if method == "_serve" else "585#4B04200008000000"
    assert feed(device, "605#4004200000000000") == [answer, INTERNAL_SOFTWARE]
    assert application.failures == [f"{place}: RuntimeError: a defect"]
    assert feed(device, "080#") == ([] if service is PdoEngine else ["185#0800"])
    assert feed(device, None, 1.0) == ["705#05"]
    assert feed(device, "000#8105", 1.0)[0] == "705#00"


def test_a_deadline_that_cannot_be_computed_is_that_of_the_heartbeat(monkeypatch: pytest.MonkeyPatch) -> None:
    def defect(engine: PdoEngine) -> float:
        raise RuntimeError("a defect")

    application = Application()
    device = application.device()
    monkeypatch.setattr(PdoEngine, "deadline", property(defect))
    assert device.deadline == 1.0
    assert feed(device, None, 0.5) == [INTERNAL_SOFTWARE]


def test_an_lss_slave_whose_store_fails() -> None:
    def store(node: int | None, rate: object) -> bool:
        raise OSError("flash")

    failures: list[str] = []
    device = LocalNode(
        5,
        ObjectDictionary(standard_objects(heartbeat=1000)),
        lss=LssSlave(LssAddress(1, 2, 3, 4), store=store),
        on_failure=lambda place, error: failures.append(f"{place}: {error}"),
    )
    device.start(0.0)
    feed(device, "7E5#0401000000000000")
    feed(device, "7E5#1700000000000000")
    assert failures == ["NMT and LSS: flash"]
    assert feed(device, None, 1.0) == ["705#7F"]


def test_a_simulator_whose_machine_fails() -> None:
    application = Application()
    adapter: Any = simulator("az3", node=5).canopen
    adapter.on_failure = application.report
    adapter.start(0.0)
    adapter.machine.tick = lambda now: application.motor(0)
    request = "605#4000100000000000"
    assert feed(adapter, request, 0.1)[0].startswith("585#43001000")
    assert application.failures == ["machine: OSError: no motor"]


WRONG = [300, -1, "x", float("nan"), float("inf"), [1], object()]


@every_case("value", WRONG)
@every_case("index", [0x1001, 0x100C, 0x1014, 0x1015, 0x1016, 0x1017])
def test_a_value_that_a_communication_object_cannot_have_is_reported(index: int, value: Any) -> None:
    application = Application()
    sub = 1 if index == 0x1016 else 0
    application.objects.replace(Entry(index, sub, "computed", "u8", "ro", on_read=lambda: value))
    device = application.device()
    feed(device, "000#0105")
    device.error(0x1000, 0.2)
    feed(device, None, 0.3)
    assert feed(device, "605#4004200000000000", 0.4)[0] == "585#4B04200007000000"
    assert application.failures[0].startswith(f"{index:04X}h:{sub:02X}: EncodeError: ")


def test_an_error_register_of_more_than_8_bits_is_sent_with_its_low_byte() -> None:
    application = Application()
    application.objects.replace(Entry(0x1001, 0, "error register", "u16", "ro", on_read=lambda: 0x1FE))
    device = application.device()
    assert [str(frame) for frame in device.error(0x1000, 0.2)] == ["085#0010FE0000000000"]
