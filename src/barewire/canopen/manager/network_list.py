"""The network list of a CANopen manager: its nodes, what each must be, and how they are started.   [CiA 302-2]

        1F80h        NMT startup, u32        bit  0  is the manager            3  does not start the slaves
                                                  1  starts all by one NMT     4  error of a mandatory slave: reset all
                                                  2  stays pre-operational     6  error of a mandatory slave: stop all
        1F81h:n      NMT slave assignment of node n, u32

                     31 ... 16    | 15 ... 8     |  6       5       4       3          2     |  0
                     guard time   | retry factor |  update  check   keep    mandatory  boot  |  in the network list
                     in ms                          program program alive              slave

        1F84h:n      device type                 1F20h:n  DCF, as text           1F53h:n  program date
        1F85h:n      vendor-ID                   1F22h:n  concise DCF            1F54h:n  program time
        1F86h:n      product code                1F26h:n  configuration date     1F55h:n  program identification
        1F87h:n      revision number             1F27h:n  configuration time     1F58h:n  program data
        1F88h:n      serial number               1016h    heartbeat times
                                                 1F89h    boot time of the mandatory slaves, ms; 0: no limit

An expected value of 0 is not checked. Below, these values are Python objects; `network_list` reads them from an object
dictionary, for example from the DCF of a manager.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from barewire.canopen.cob_ids import check_node
from barewire.canopen.communication_objects import integer_value
from barewire.canopen.configuration.configure import ConciseValue, decode_concise_dcf
from barewire.canopen.configuration.settings import DEVICE_TYPE, DeviceConfiguration, device_configuration
from barewire.canopen.nmt.messages import consumer_entry
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.errors import BarewireError, DecodeError, EncodeError, shown


@dataclass(frozen=True, slots=True)
class BootSlave:
    """One node of the network list, and what the manager expects of it.

        node             the node-ID
        mandatory        the network does not start without it                                       1F81h bit 3
        boot             the manager boots and starts it; otherwise only its error control starts    1F81h bit 2
        keep_alive       it is not reset if it is operational                                        1F81h bit 4
        listed           it is in the network list                                                   1F81h bit 0
        check_program    its program is compared with `software` and `software_date`                 1F81h bit 5
        update_program   another program is replaced by `program`                                    1F81h bit 6
        guard_time       seconds between two requests of node guarding, if it has no heartbeat       1F81h
        retry_factor     after how many guard times without response it counts as lost               1F81h
        heartbeat        seconds after which it counts as lost without a heartbeat; 0: none          1016h
        device_type, vendor, product, revision, serial      what it must be; 0: not checked          1F84h to 1F88h
        date             configuration date and time (1020h:01, :02); (0, 0): always configured      1F26h, 1F27h
        configuration    what is written if the date differs: a `DeviceConfiguration`, or the values
                         of a concise DCF                                                     1F20h or 1F22h
        concise          further values, written after `configuration`: the concise DCF beside a DCF  1F22h
        software         the program identification (1F56h:01) that it must have; 0: not checked     1F55h
        software_date    date and time of the program (1F52h:01, :02); (0, 0): not checked    1F53h, 1F54h
        program          the bytes of that program                                                   1F58h

    >>> BootSlave(5, mandatory=True, vendor=0x360)
    <BootSlave 5: mandatory>
    """

    node: int
    mandatory: bool = False
    boot: bool = True
    keep_alive: bool = False
    listed: bool = True
    check_program: bool = False
    update_program: bool = False
    guard_time: float = 0.0
    retry_factor: int = 0
    heartbeat: float = 0.0
    device_type: int = 0
    vendor: int = 0
    product: int = 0
    revision: int = 0
    serial: int = 0
    date: tuple[int, int] = (0, 0)
    configuration: DeviceConfiguration | tuple[ConciseValue, ...] = ()
    software: int = 0
    program: bytes = b""
    software_date: tuple[int, int] = (0, 0)
    concise: tuple[ConciseValue, ...] = ()

    def __post_init__(self) -> None:
        check_node(self.node)
        if not (0 <= self.guard_time < float("inf") and self.heartbeat >= 0):
            times = f"guard time {self.guard_time} s, heartbeat {self.heartbeat} s"
            raise EncodeError(f"node {self.node}: {times}: expected 0 or more")

    def __repr__(self) -> str:
        names = "mandatory", "keep_alive", "check_program", "update_program"
        words = [name.replace("_", " ") for name in names if getattr(self, name)]
        return f"<BootSlave {self.node}: {', '.join(words) or 'optional'}>"


@dataclass(frozen=True, slots=True)
class NetworkList:
    """The nodes of a network, and how its manager starts them.

        slaves           the nodes, in the order of their node-IDs
        start_all        one NMT command starts all nodes, if each of them has booted         1F80h bit 1
        start_slaves     the manager starts slaves; otherwise the application does            1F80h bit 3 = 0
        reset_all        an error of a mandatory slave resets all nodes                       1F80h bit 4
        stop_all         an error of a mandatory slave stops all nodes                        1F80h bit 6
        boot_time        seconds for mandatory slaves to boot; 0: no limit                    1F89h
        node             the node-ID of the manager, which does not reset itself; None: it has none

    >>> NetworkList([BootSlave(6), BootSlave(5, mandatory=True)], boot_time=10)
    <NetworkList: 2 nodes, 1 of them mandatory>
    """

    slaves: Sequence[BootSlave]
    start_all: bool = False
    start_slaves: bool = True
    reset_all: bool = False
    stop_all: bool = False
    boot_time: float = 0.0
    node: int | None = None

    def __post_init__(self) -> None:
        slaves = tuple(self.slaves)
        for slave in slaves:
            if not isinstance(slave, BootSlave):
                raise EncodeError(f"NetworkList: {shown(slave)}: expected a BootSlave, such as BootSlave(5)", "slaves")
        object.__setattr__(self, "slaves", tuple(sorted(slaves, key=lambda slave: slave.node)))
        numbers = [slave.node for slave in self.slaves]
        for number in numbers:
            if numbers.count(number) > 1 or number == self.node:
                raise EncodeError(f"node {number} is in the network list twice, or is the manager itself")
        if not self.boot_time >= 0:
            raise EncodeError(f"boot time {self.boot_time} s: expected 0 or more")

    def __repr__(self) -> str:
        mandatory = sum(slave.mandatory for slave in self.slaves)
        return f"<NetworkList: {len(self.slaves)} nodes, {mandatory} of them mandatory>"


def checked_network(network: object) -> NetworkList:
    """Return the network list. Raise EncodeError for anything else, such as a list of slaves."""
    if not isinstance(network, NetworkList):
        text = "expected a NetworkList, such as NetworkList([BootSlave(5, mandatory=True)])"
        raise EncodeError(f"network = {shown(network)}: {text}", "network")
    return network


def slave_of(configuration: DeviceConfiguration, *, mandatory: bool = False, heartbeat: float = 0.0) -> BootSlave:
    """Return the slave that a DCF describes: its identity, its configuration and the date of that.

    `heartbeat` is the time after which it counts as lost; the heartbeat time of the node itself (1017h) is in its DCF.
    """
    known = {setting.place: int(setting.value) for setting in configuration.identity}
    date = [int(setting.value) for setting in configuration.date]
    return BootSlave(
        configuration.node,
        mandatory,
        heartbeat=heartbeat,
        device_type=known.get((DEVICE_TYPE, 0), 0),
        vendor=known.get((0x1018, 1), 0),
        product=known.get((0x1018, 2), 0),
        revision=known.get((0x1018, 3), 0),
        serial=known.get((0x1018, 4), 0),
        date=(date[0], date[1]) if date else (0, 0),
        configuration=configuration,
    )


def network_list(objects: ObjectDictionary, node: int | None = None) -> NetworkList:
    """Return the network list in the object dictionary of a manager. Only nodes with bit 0 of 1F81h are slaves.

    Of a node with both a DCF (1F20h) and a concise DCF (1F22h), the values of the DCF are written first.

    Raise EncodeError if 1F80h does not make it a manager, and for a DCF that is stored in another format than text;
    DecodeError for a 1F22h:n that is not a concise DCF.
    """
    startup = integer_value(objects, 0x1F80, 0)
    if not startup & 1:
        raise EncodeError(f"1F80h = {startup:X}h: expected bit 0, which makes the device the manager of its network")
    heartbeats = {}
    for sub in objects.subs(0x1016)[1:]:
        if (watched := consumer_entry(integer_value(objects, 0x1016, sub))) is not None:
            heartbeats[watched[0]] = watched[1]
    slaves = [
        _slave(objects, number, word, heartbeats.get(number, 0.0))
        for number in objects.subs(0x1F81)
        if 1 <= number <= 127 and number != node and (word := integer_value(objects, 0x1F81, number)) & 1
    ]
    return NetworkList(
        slaves,
        start_all=bool(startup & 2),
        start_slaves=not startup & 8,
        reset_all=bool(startup & 0x10),
        stop_all=bool(startup & 0x40),
        boot_time=integer_value(objects, 0x1F89, 0) / 1000,
        node=node,
    )


def _slave(objects: ObjectDictionary, node: int, word: int, heartbeat: float) -> BootSlave:
    try:
        values = tuple(decode_concise_dcf(_bytes(objects, 0x1F22, node)))
    except DecodeError as error:
        error.add_context(f"concise DCF of node {node}, 1F22h:{node:02X}")
        raise
    date = integer_value(objects, 0x1F26, node), integer_value(objects, 0x1F27, node)
    configuration = _stored_dcf(objects, node, date)
    return BootSlave(
        node,
        mandatory=bool(word & 8),
        boot=bool(word & 4),
        keep_alive=bool(word & 0x10),
        check_program=bool(word & 0x20),
        update_program=bool(word & 0x40),
        guard_time=(word >> 16) / 1000,
        retry_factor=word >> 8 & 0xFF,
        heartbeat=heartbeat,
        device_type=integer_value(objects, 0x1F84, node),
        vendor=integer_value(objects, 0x1F85, node),
        product=integer_value(objects, 0x1F86, node),
        revision=integer_value(objects, 0x1F87, node),
        serial=integer_value(objects, 0x1F88, node),
        date=date,
        configuration=values if configuration is None else configuration,
        concise=() if configuration is None else values,
        software=integer_value(objects, 0x1F55, node),
        program=_bytes(objects, 0x1F58, node),
        software_date=(integer_value(objects, 0x1F53, node), integer_value(objects, 0x1F54, node)),
    )


def _stored_dcf(objects: ObjectDictionary, node: int, date: tuple[int, int]) -> DeviceConfiguration | None:
    """Return the configuration that 1F20h:n has, None without one. It stamps 1020h with the expected date."""
    from barewire.canopen.eds.eds_file import parse

    text = _bytes(objects, 0x1F20, node)
    if not text:
        return None
    storage = integer_value(objects, 0x1F21, node)
    if storage:
        place = f"DCF of node {node}: 1F21h:{node:02X} = {storage}"
        raise EncodeError(f"{place}: expected 0, which is text; other formats are those of a manufacturer")
    try:
        configuration = device_configuration(parse(text), node)
    except BarewireError as error:
        error.add_context(f"DCF of node {node}, 1F20h:{node:02X}")
        raise
    if date == (0, 0):
        return configuration
    stamp = tuple(setting._replace(value=value) for setting, value in zip(configuration.date, date))
    return replace(configuration, date=stamp)


def _bytes(objects: ObjectDictionary, index: int, sub: int) -> bytes:
    value = objects.get(index, sub) if (index, sub) in objects else b""
    return value if isinstance(value, bytes) else b""
