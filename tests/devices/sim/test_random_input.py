"""Random writes and frames: a machine answers or declines, and every value can still be read."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from barewire.canopen import CanFrame
from barewire.devices.cia402 import State, state_of
from barewire.devices.description.load import names
from barewire.devices.sim import simulator
from barewire.modbus.exceptions import ModbusException
from barewire.modbus.messages.registers import WriteMultipleRegisters, WriteSingleRegister
from tests.devices.sim.bench import Bench

pytestmark = pytest.mark.long

WORDS = st.integers(0, 0xFFFF) | st.sampled_from([0, 1, 3, 6, 7, 0x0F, 0x1F, 0x3F, 0x80, 0x10F, 0x7F80, 0xFF80])
PAUSES = st.sampled_from([0.0, 0.001, 0.3, 7.0, 1e5])


@pytest.mark.parametrize("name", names())
@given(data=st.data())
def test_after_any_writes_every_value_can_be_read(name: str, data: st.DataObject) -> None:
    bench = Bench(simulator(name))
    adapter = bench.machine.modbus
    assert adapter is not None
    code, image = next((code, adapter.writes[code]) for code in (0x10, 0x06) if code in adapter.writes)
    places = sorted(image.words)
    for _ in range(data.draw(st.integers(1, 12))):
        address = data.draw(st.sampled_from(places))
        words = tuple(data.draw(st.lists(WORDS, min_size=1, max_size=4)))
        single = code == 0x06 or data.draw(st.booleans())
        bench.refused(WriteSingleRegister(address, words[0]) if single else WriteMultipleRegisters(address, words))
        bench.now += data.draw(PAUSES)
        bench.machine.tick(bench.now)
    bench.now += 10.0  # a reboot is over
    for parameter in bench.machine.device.parameters:
        if parameter.modbus is not None and parameter.readable:
            try:
                bench.read(parameter.name)
            except ModbusException:
                assert name == "adxl"  # a menu without such a parameter, a list without such an event


@given(st.lists(st.tuples(st.sampled_from([0x000, 0x080, 0x201, 0x301, 0x401, 0x501, 0x601]), st.binary(max_size=8))))
def test_after_any_frames_the_drive_is_in_a_state(frames: list[tuple[int, bytes]]) -> None:
    bench = Bench(simulator("az3"))
    assert bench.machine.canopen is not None
    bench.frames("000#0101")
    for identifier, data in frames:
        bench.machine.canopen.feed(CanFrame(identifier, data), bench.now)
        bench.now += 0.1
    assert isinstance(state_of(int(bench.read("STATUS WORD"))), State)
