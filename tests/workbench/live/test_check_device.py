"""A machine is asked what it is: each of the catalogue is told from the others, and a silent one is asked once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from barewire import CanopenServer, ModbusServer, connect, load
from barewire.devices import Device
from barewire.devices.sim import simulator
from barewire.errors import NoAnswer
from barewire.modbus import AnyUnit
from barewire.modbus.exceptions import ModbusException
from barewire_workbench.live.check_device import WrongDevice, check_device
from barewire_workbench.scan.identity import DeviceIdentity, contradiction

MACHINES = ("adxl", "az3", "csd-mt")


def unit_of(name: str) -> AnyUnit:
    unit = simulator(name).modbus
    assert unit is not None
    return unit


def sent_for(device: str | Device, url: str, *, before_write: bool = False) -> list[bytes]:
    """Check the device, and return the frames that were sent for that."""
    frames: list[bytes] = []
    with connect(
        device, url, watch=lambda direction, data: frames.append(bytes(data)) if direction == "sent" else None
    ) as machine:
        try:
            check_device(machine, before_write=before_write)
        except Exception as error:
            error.frames = frames  # type: ignore[attr-defined]
            raise
    return frames


@pytest.mark.parametrize("name", MACHINES)
def test_each_machine_is_told_from_the_others(name: str) -> None:
    with ModbusServer("tcp://127.0.0.1:0", {1: unit_of(name)}) as server:
        assert len(sent_for(name, server.url)) == (2 if name == "csd-mt" else 1)
        for other in MACHINES:
            if other != name:
                with pytest.raises(WrongDevice, match=f"unit 1 is not {other}"):
                    sent_for(other, server.url)


class _Refusing:
    """A unit that answers everything with one exception."""

    def __init__(self, code: int) -> None:
        self.code = code

    def handle(self, request: Any, now: float) -> Any:
        raise ModbusException(self.code)


@pytest.mark.parametrize("code", [0x06, 0x0A, 0x0B])
def test_a_busy_unit_or_a_gateway_without_one_says_nothing_about_it(code: int) -> None:
    with ModbusServer("tcp://127.0.0.1:0", {1: _Refusing(code)}) as server:
        for name in MACHINES:
            sent_for(name, server.url)


@pytest.mark.parametrize("code", [0x02, 0x04, 0x06, 0x0A, 0x0B])
def test_a_unit_that_does_not_say_what_its_manual_promises_is_not_written_to(code: int) -> None:
    with ModbusServer("tcp://127.0.0.1:0", {1: _Refusing(code)}) as server:
        for name in ("az3", "adxl"):
            with pytest.raises(WrongDevice, match=f"unit 1 did not say what it is, as {name} does"):
                sent_for(name, server.url, before_write=True)
        sent_for("csd-mt", server.url, before_write=True)  # its manual promises nothing


def test_a_silent_unit_is_asked_once_and_is_not_written_to() -> None:
    with ModbusServer("rtu://pty", {2: unit_of("adxl")}) as server:
        url = f"{server.url}?unit=1&timeout=0.05"
        for name in MACHINES:
            assert len(sent_for(name, url)) == 1
        assert len(sent_for("csd-mt", url, before_write=True)) == 1  # nothing says that it had to answer
        with pytest.raises(NoAnswer) as error:
            sent_for("adxl", url, before_write=True)
        assert len(error.value.frames) == 1  # type: ignore[attr-defined]


def test_a_description_without_the_table_is_not_asked() -> None:
    az3 = load("az3")
    own = replace(az3, extra={key: table for key, table in az3.extra.items() if key != "identity"})
    with ModbusServer("tcp://127.0.0.1:0", {1: unit_of("adxl")}) as server:
        assert sent_for(own, server.url) == []


def with_identity(**table: Any) -> Device:
    az3 = load("az3")
    return replace(az3, extra={**az3.extra, "identity": table})


def test_a_node_is_compared_with_its_numbers() -> None:
    with CanopenServer("can://memory/check?node=1", device="az3") as server:
        for table in ({"texts": ["AZ3"]}, {"vendor": 0}, {"device_type": 0x20192}):
            with connect(with_identity(**table), server.url) as node:
                check_device(node, before_write=True)
        with (
            connect(with_identity(vendor=7), server.url) as node,
            pytest.raises(WrongDevice, match=r"node 1 is not az3: it says profile 402 \(drives\)"),
        ):
            check_device(node)
        silent = "can://memory/check?node=9&timeout=0.05"
        with connect("az3", silent) as node:
            check_device(node)
            with pytest.raises(NoAnswer):
                check_device(node, before_write=True)


@pytest.mark.parametrize(("numbers", "is_other"), [({"device_type": 0x191}, True), ({"device_type": 0}, False)])
def test_the_profile_of_a_drive(numbers: Mapping[str, int], is_other: bool) -> None:
    assert bool(contradiction(DeviceIdentity(numbers=dict(numbers)), (), load("az3"))) == is_other
