"""One node of a bus, with the methods of a client for it: `bus.node(5, device="az3")`.

    bus.node(5)                        node.sdo, node.nmt, node.pdo, node.emergencies()
    bus.node(5, device="az3")          also values with units by name, and node.drive       (`io.named_values`)
    bus.node(5, eds="drive.eds")       also values by the names of an EDS, by index, by (index, sub-index)
    bus.node(5, dcf="pump.dcf")        also node.diff() and node.configure(), with the configuration of a DCF

A `Node` holds no connection: there may be any number for the same node.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any, NamedTuple

from barewire import canopen
from barewire._html import html_table
from barewire.canopen.sdo.dialect import SdoDialect
from barewire.errors import DecodeError, EncodeError, Refused, shown
from barewire.io.canopen.bus.subscriber import Key, check_key
from barewire.io.canopen.nmt import NodeNmtMethods
from barewire.io.canopen.objects import SdoMethods, read_by_name, write_by_name
from barewire.io.canopen.operations import (
    AnyOperation,
    AsyncBusRunner,
    BlockingBusRunner,
    BusOperation,
    Methods,
    R,
    Subscription,
    operation,
    sdo_transfer,
    subscription,
)
from barewire.io.named_values import AsyncNamedValues, CanopenNames, NamedValues

if TYPE_CHECKING:
    from pathlib import Path

    from barewire.canopen.configuration.configure import ConfigurationResult, ConfigureProgress
    from barewire.canopen.configuration.settings import DeviceConfiguration, Difference
    from barewire.canopen.eds.eds_file import Eds
    from barewire.canopen.object_dictionary import Entry, ObjectDictionary, ObjectRef
    from barewire.canopen.sdo.channel import Channel
    from barewire.canopen.sdo.client import BlockMode
    from barewire.codecs import Value
    from barewire.conversation import Conversation
    from barewire.devices.device import Device
    from barewire.devices.parameter import Reading
    from barewire.io.canopen.objects import PdoMethods

_NAMED = {"read", "read_all", "write", "drive"}
_OF_DCF = {"configure", "diff"}


def check_node_id(number: int) -> int:
    """Return the node-ID. Raises EncodeError for any other object, and outside 1..127."""
    if isinstance(number, bool) or not isinstance(number, int) or not 1 <= number <= 127:
        raise EncodeError(f"node {number!r}: expected a number in 1..127", "node")
    return number


class Node(Methods[R]):
    """A node by its number. `timeout` (seconds) is that of calls that give none."""

    def __init__(
        self,
        runner: R,
        number: int,
        *,
        timeout: float,
        dialect: SdoDialect,
        names: ObjectDictionary | Device | None = None,
    ) -> None:
        super().__init__(runner)
        self.number = check_node_id(number)
        self.timeout = timeout
        self.sdo: SdoMethods[R] = SdoMethods(runner, number, timeout=timeout, dialect=dialect)
        self.nmt: NodeNmtMethods[R] = NodeNmtMethods(runner, number)
        self._objects = names

    def __repr__(self) -> str:
        return f"<node {self.number} of {self.runner!r}>"

    @property
    def channel(self) -> Channel:
        """The channel to the default SDO server of the node."""
        return self.sdo.channel

    @cached_property
    def pdo(self) -> PdoMethods[R]:
        """The process data of the node, with the names of its device or EDS."""
        from barewire.io.canopen.objects import PdoMethods

        return PdoMethods(self.sdo, self._objects)

    @subscription
    def emergencies(self, cob_id: Key | None = None) -> Subscription[canopen.EmcyEvent]:
        """Return a stream of the errors that the node reports. `cob_id` is the (identifier, extended) of its emergency
        messages if object 1014h has another one than 80h + node."""
        key = (0x80 + self.number, False) if cob_id is None else check_key(cob_id)
        consumer = canopen.EmcyConsumer({key: self.number}, listed_only=True)
        return Subscription(consumer, frozenset({key, (0x700 + self.number, False)}))

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name in _NAMED:
                described = f"bus.node({self.number}, device=...)"
                if name != "drive":
                    described += f" or bus.node({self.number}, eds=...); without: node.sdo"
                raise AttributeError(f"node {self.number}: {name!r} needs names: {described}")
            if name in _OF_DCF:
                raise AttributeError(f"node {self.number}: {name!r} needs a DCF: bus.node({self.number}, dcf=...)")
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")


class ObjectReading(NamedTuple):
    """An object of the dictionary and the value that was read."""

    entry: Entry
    value: Value

    @property
    def name(self) -> str:
        """The name of the object in the dictionary. Entries of several records may share it."""
        return self.entry.name

    def __repr__(self) -> str:
        return f"<ObjectReading {self.entry.index:04X}h:{self.entry.sub:02X} {self.name} = {self.value!r}>"


class ObjectReadings(list[ObjectReading]):
    """The readings of one call, in their order. A notebook shows them as a table."""

    def _repr_html_(self) -> str:
        rows = ((f"{entry.index:04X}h:{entry.sub:02X}", entry.name, value) for entry, value in self)
        return html_table(("object", "name", "value"), rows)


class EdsNode(Node[R]):
    """A node whose objects have the names and types of an EDS or another dictionary."""

    def __init__(
        self, runner: R, number: int, objects: ObjectDictionary, *, timeout: float, dialect: SdoDialect
    ) -> None:
        super().__init__(runner, number, timeout=timeout, dialect=dialect, names=objects)
        self.objects = objects

    @operation
    def read(self, place: ObjectRef, *, block: BlockMode = False, timeout: float | None = None) -> AnyOperation[Value]:
        """Read the value of an object by name, by index, or by (index, sub-index).

        Raises EncodeError for an object that the EDS does not have, DecodeError for a value that is not of its type,
        SdoAbort, NoAnswer, PortError.
        """
        return read_by_name(self.channel, self.objects, place, block, self.timeout if timeout is None else timeout)

    @operation
    def read_all(self, places: Iterable[ObjectRef] | None = None) -> BusOperation[list[ObjectReading]]:
        """Read the objects at `places`, in their order. Without places, read every readable object, and leave out those
        that the node refuses."""
        if isinstance(places, (str, int)):
            raise EncodeError(f"read_all({places!r}): expected several objects; one is read({places!r})")
        if places is None:
            entries = [entry for entry in self.objects if entry.access != "wo"]
        else:
            entries = [self.objects.at(place) for place in places]
        return sdo_transfer(self.channel, self._read_entries(entries, skip_refused=places is None), self.timeout)

    def _read_entries(
        self, entries: Iterable[Entry], *, skip_refused: bool
    ) -> Conversation[canopen.CanFrame, list[ObjectReading]]:
        readings = ObjectReadings()
        for entry in entries:
            place = entry.index, entry.sub
            try:
                value = yield from canopen.read_object(self.channel, self.objects, place, timeout=self.timeout)
            except (Refused, DecodeError):
                if not skip_refused:
                    raise
            else:
                readings.append(ObjectReading(entry, value))
        return readings

    @operation
    def write(
        self, place: ObjectRef, value: Value, *, block: BlockMode = False, timeout: float | None = None
    ) -> AnyOperation[None]:
        """Write an object, once. Raises EncodeError, before anything is sent, if the value does not fit its type."""
        wait = self.timeout if timeout is None else timeout
        return write_by_name(self.channel, self.objects, place, value, block, wait)


class Differences(list["Difference"]):
    """The differences between a device and its configuration, in the order of the objects. A notebook shows them as a
    table."""

    def _repr_html_(self) -> str:
        from barewire.canopen.configuration.settings import object_text, value_text

        rows = (
            (object_text(entry), reason if present is None else value_text(entry, present), value_text(entry, wanted))
            for entry, present, wanted, reason in self
        )
        return html_table(("object", "device", "configuration"), rows)


class DcfNode(EdsNode[R]):
    """A node with the configuration of a DCF; its objects have names and types too."""

    def __init__(
        self,
        runner: R,
        number: int,
        objects: ObjectDictionary,
        configuration: DeviceConfiguration,
        *,
        timeout: float,
        dialect: SdoDialect,
    ) -> None:
        super().__init__(runner, number, objects, timeout=timeout, dialect=dialect)
        self.configuration = configuration

    @operation
    def diff(
        self, *, timeout: float | None = None, progress: ConfigureProgress | None = None
    ) -> BusOperation[Differences]:
        """Read the objects of the DCF, and return those whose values differ: identity, settings, 1020h.

        progress    called as progress(done, total, step) before each object is read
        timeout     seconds that each response may take; by default the node's

        Nothing is written. Write-only objects are always listed. Raises SdoAbort, NoAnswer, PortError.
        """
        from barewire.canopen.configuration.configure import compare_device

        wait = self.timeout if timeout is None else timeout
        comparing = compare_device(self.channel, self.configuration, timeout=wait, progress=progress)
        return sdo_transfer(self.channel, _differences(comparing), wait)

    @operation
    def configure(
        self,
        *,
        store: bool = False,
        dry_run: bool = False,
        timeout: float | None = None,
        progress: ConfigureProgress | None = None,
    ) -> BusOperation[ConfigurationResult]:
        """Write the values that differ, read them back, and write the date of the DCF to 1020h.

        store       then store all parameters by 1010h:01; otherwise the next reset of the device loses them
        dry_run     write nothing, and return what would be written
        progress    called as progress(done, total, step) before each step
        timeout     seconds that each response may take; by default the node's

        PDOs that change are off meanwhile. The node should be pre-operational: `nmt.pre_operational()`. Raises
        ConfigurationFailed for a device of another type, one without an object of the DCF, or a value that is not the
        written one; SdoAbort for a value that the device refuses; NoAnswer, PortError.
        """
        from barewire.canopen.configuration.configure import configure_device

        wait = self.timeout if timeout is None else timeout
        configuring = configure_device(
            self.channel, self.configuration, store=store, dry_run=dry_run, timeout=wait, progress=progress
        )
        return sdo_transfer(self.channel, configuring, wait)


def _differences(
    comparing: Conversation[canopen.CanFrame, list[Difference]],
) -> Conversation[canopen.CanFrame, Differences]:
    return Differences((yield from comparing))


class DeviceNode(Node[BlockingBusRunner], CanopenNames, NamedValues):
    """A node that is a described device."""

    def __init__(
        self, runner: BlockingBusRunner, number: int, device: Device, *, timeout: float, dialect: SdoDialect
    ) -> None:
        Node.__init__(self, runner, number, timeout=timeout, dialect=dialect, names=device)
        self.device = device

    def _read(self, names: Sequence[str]) -> list[Reading]:
        return self.runner.carry_out(_read_device(self, self.device, names))

    def _write(self, values: Mapping[str, Value], force: bool) -> None:
        self.runner.carry_out(_write_device(self, self.device, values, force))


class AsyncDeviceNode(Node[AsyncBusRunner], CanopenNames, AsyncNamedValues):
    """A node that is a described device, for asyncio."""

    def __init__(
        self, runner: AsyncBusRunner, number: int, device: Device, *, timeout: float, dialect: SdoDialect
    ) -> None:
        Node.__init__(self, runner, number, timeout=timeout, dialect=dialect, names=device)
        self.device = device

    async def _read(self, names: Sequence[str]) -> list[Reading]:
        return await self.runner.open_and_carry_out(lambda: _read_device(self, self.device, names))

    async def _write(self, values: Mapping[str, Value], force: bool) -> None:
        await self.runner.open_and_carry_out(lambda: _write_device(self, self.device, values, force))


def _read_device(node: Node[Any], device: Device, names: Sequence[str]) -> BusOperation[list[Reading]]:
    from barewire.devices.canopen_access import read_canopen

    return sdo_transfer(node.channel, read_canopen(node.channel, device, names, timeout=node.timeout), node.timeout)


def _write_device(node: Node[Any], device: Device, values: Mapping[str, Value], force: bool) -> BusOperation[None]:
    from barewire.devices.canopen_access import write_canopen

    writing = write_canopen(node.channel, device, values, timeout=node.timeout, force=force)
    return sdo_transfer(node.channel, writing, node.timeout)


def dictionary_of(eds: str | Path | Eds | ObjectDictionary, node: int) -> ObjectDictionary:
    """Return the object dictionary of a node: that of an EDS, parsed or as a file, or the dictionary itself.

    Raises EncodeError for a file that cannot be read.
    """
    from barewire.canopen.object_dictionary import ObjectDictionary

    if isinstance(eds, ObjectDictionary):
        return eds
    return parsed_eds(eds).dictionary(node)


def parsed_eds(eds: str | Path | Eds, what: str = "eds") -> Eds:
    """Return a parsed EDS or DCF: as it is, or from a file. `what` is the name of the argument in an error.

    Raises EncodeError for a file that cannot be read, or describes no object.
    """
    from barewire.canopen.eds.eds_file import Eds, parse

    if isinstance(eds, Eds):
        return eds
    try:
        with open(fspath(eds), "rb") as file:
            data = file.read()
    except (OSError, TypeError, ValueError) as error:
        expected = "an EDS, or an ObjectDictionary" if what == "eds" else "or a parsed DCF"
        why = error.strerror if isinstance(error, OSError) else f"expected a path, {expected}"
        given = shown(fspath(eds), 200) if isinstance(eds, (str, PathLike)) else shown(eds)
        raise EncodeError(f"{what} {given}: {why}", what) from None
    described = parse(data)
    if not described.objects:
        raise EncodeError(f"{what} {shown(str(eds))}: the file describes no object", what)
    return described


def dcf_node(runner: R, number: int | None, dcf: str | Path | Eds, **settings: Any) -> DcfNode[R]:
    """Return the node of a DCF. Its number is by default that of the file.

    Raises EncodeError for a file that cannot be read, that has no node-ID while none is given, or that is an EDS.
    """
    from barewire.canopen.configuration.settings import device_configuration

    parsed = parsed_eds(dcf, "dcf")
    configuration = device_configuration(parsed, None if number is None else check_node_id(number))
    return DcfNode(runner, configuration.node, parsed.dictionary(configuration.node), configuration, **settings)
