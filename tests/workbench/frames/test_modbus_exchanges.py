"""Registers of an exchange as values of a device."""

from __future__ import annotations

from barewire.devices import load
from barewire.rtu import encode
from barewire_workbench.frames.modbus_exchanges import Exchanges, RegisterNames, UnitNames, exchange_as_dict
from barewire_workbench.recordings.modbus_replay import replay
from tests.helpers import unhex

ADXL = UnitNames({None: RegisterNames(load("adxl"))})


def lines_of(*pdus: str, names: UnitNames = ADXL, unit: int = 1) -> list[str]:
    log = "\n".join(
        f"{'Rx' if place % 2 else 'Tx'}: {encode(unit, unhex(pdu)).hex(' ')}" for place, pdu in enumerate(pdus)
    )
    lines = Exchanges(timed=False, names=names)
    return [str(line) for event in replay(log.encode()) for line in lines.feed(event)] + [*map(str, lines.end())]


def test_a_scaled_value_with_its_unit() -> None:
    assert lines_of("04 0FB1 0002", "04 04 0000 0110") == [
        "unit 1  Read Input Registers, 2 from 0FB1h -> Thyristors temperature = 27.2 °C"
    ]


def test_half_a_value_is_none() -> None:
    assert lines_of("04 0FB1 0001", "04 02 0000") == ["unit 1  Read Input Registers, 1 from 0FB1h -> 0"]


def test_registers_without_a_name_keep_their_number() -> None:
    (line,) = lines_of("04 0FB0 0003", "04 06 0007 0000 0110")
    assert line.endswith("-> Thyristors temperature = 27.2 °C, 0FB0h: 7")


def test_a_refused_write_has_no_value() -> None:
    parameter = next(found for found in load("adxl").parameters if found.modbus and found.modbus.table == "holding"
                     and found.writable and found.modbus.words == 1 and not found.modbus.partial)  # fmt: skip
    assert parameter.modbus is not None
    request = f"06 {parameter.modbus.address:04X} 0001"
    (done,) = lines_of(request, request)
    assert f"-> done: set {parameter.name} = " in done
    (refused,) = lines_of(request, "86 03")
    assert "set" not in refused


def test_names_belong_to_a_unit() -> None:
    first = UnitNames({2: RegisterNames(load("adxl"))})
    assert lines_of("04 0FB1 0002", "04 04 0000 0110", names=first)[0].endswith("-> 0 272")
    assert lines_of("04 0FB1 0002", "04 04 0000 0110", names=first, unit=2)[0].endswith("27.2 °C")


def test_values_for_programs() -> None:
    log = b"1.0 " + encode(1, unhex("04 0FB1 0002")).hex().encode()
    log += b"\n1.1 " + encode(1, unhex("04 04 0000 0110")).hex().encode()
    *_, response = (exchange_as_dict(event, names=ADXL) for event in replay(log))
    assert response["values"] == [{"name": "Thyristors temperature", "value": 27.2, "unit": "°C", "text": "27.2 °C"}]
