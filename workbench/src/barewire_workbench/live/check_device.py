"""Ask a machine what it is before its values are read or written by name.

    az3 at unit 1    2B/0Eh  ->   TEM AZ3 1.84                 it is one: one request, once for each connection
                             ->   exception 01                 an AZ3 answers that: it is another device
                             ->   nothing in time              not known: a read goes on, a write does not begin
    csd-mt           11h     ->   exception 01                 nothing speaks against it: its manual prints nothing by
                     2B/0Eh  ->   exception 01                 which it could be told, only other machines are excluded

What a description expects is in its table [identity] (`barewire_workbench.scan.identity`); one without is not asked.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from barewire import ModbusClient, NoAnswer
from barewire.errors import BarewireError, DecodeError, PortError, Refused
from barewire.modbus.exceptions import ILLEGAL_FUNCTION
from barewire_workbench.scan.identity import DeviceIdentity, check_identity_table, contradiction

if TYPE_CHECKING:
    from barewire.devices import Device
    from barewire.io.canopen.node import DeviceNode
    from barewire.io.machine import MachineClient

_OTHERS_TIMEOUT = 0.5
"""Seconds that a unit has for a question which its manual does not mention: it may be silent."""

_NOBODY = (0x0A, 0x0B)
"""The exceptions of a gateway whose unit does not answer."""


class WrongDevice(BarewireError):
    """What answers is another machine than the one that is described."""


class _Question(NamedTuple):
    """A question, the key of [identity] that its answer is compared with, and whether it must be answered."""

    key: str
    ask: Callable[[], None]
    is_promised: bool = True


def check_device(machine: MachineClient, *, before_write: bool = False) -> bool:
    """Ask a machine what it is, and return whether it answered. Raises WrongDevice if it is another one than
    `machine.device`.

    A unit that does not answer is asked only once. Before a write that is an error, NoAnswer, if it had to
    answer; before a read the check is left out.

    >>> from barewire import ModbusServer, connect
    >>> from barewire.devices.sim import simulator
    >>> with ModbusServer("tcp://127.0.0.1:0", {1: simulator("csd-mt").modbus}) as server:
    ...     with connect("az3", server.url) as machine:
    ...         check_device(machine)
    Traceback (most recent call last):
        ...
    barewire_workbench.live.check_device.WrongDevice: unit 1 is not az3: it refuses function 2B/0Eh, which az3 answers
    """
    device, client = machine.device, machine.client
    table = device.extra.get("identity")
    if table is None:
        return True
    check_identity_table(device)
    identity, refused = DeviceIdentity(), set()
    if isinstance(client, ModbusClient):
        name = f"unit {client.unit_for(None, device)}"
        questions = _questions_to_unit(client, device, table, identity)
    else:
        node = client.node(getattr(machine, "node", None), device=device)
        name = f"node {node.number}"
        questions = _questions_to_node(node, device, table, identity)
    asked, has_answered = [], True
    for question in questions:
        asked.append(question)
        try:
            question.ask()
        except (NoAnswer, PortError):
            if before_write and question.is_promised:
                raise
            has_answered = False
            break  # what it has told until now still counts
        except DecodeError:
            pass
        except Refused as error:
            code = getattr(error, "code", 0)
            if code in _NOBODY and not before_write:
                return False
            if code == ILLEGAL_FUNCTION:
                refused.add(question.key)
    why = contradiction(identity, refused, device)
    if why:
        raise WrongDevice(f"{name} is not {device.name}: {why}")
    if before_write and not str(identity) and any(question.is_promised for question in asked):
        raise WrongDevice(f"{name} did not say what it is, as {device.name} does (--no-check goes on)")
    return has_answered


def _questions_to_unit(
    client: ModbusClient, device: Device, table: Mapping[str, Any], identity: DeviceIdentity
) -> Iterator[_Question]:
    """Yield what the manual says that the unit answers; then, while it has told nothing, the other questions."""
    from barewire_workbench.live.scan_modbus import QUESTIONS

    unit = client.unit_for(None, device)
    client = client.at(unit=unit)
    shorter = client.at(unit=unit, timeout=min(_OTHERS_TIMEOUT, client.timeout))
    for key, ask in sorted(QUESTIONS.items(), key=lambda question: question[0] not in table):
        if key in table:
            yield _Question(key, partial(ask, client, identity))
        elif not str(identity):
            yield _Question(key, partial(ask, shorter, identity), is_promised=False)


def _questions_to_node(
    node: DeviceNode, device: Device, table: Mapping[str, Any], identity: DeviceIdentity
) -> Iterator[_Question]:
    """Yield the objects that the table names, and 1000h of a drive, which has the profile 402. A node that has an SDO
    server answers each, if only by an abort."""
    from barewire_workbench.live.scan_canopen import ask

    upload = node.sdo.upload
    keys = {"device_type": "device_type", "vendor": "vendor", "product": "product", "texts": "name"}
    for key, of_node in keys.items():
        if key in table or (key == "device_type" and device.drive is not None):
            yield _Question(key, partial(ask, upload, of_node, identity))
