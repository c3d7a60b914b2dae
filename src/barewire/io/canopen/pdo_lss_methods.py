"""The words of CANopen for PDOs and LSS, once for both clients.

    rpdo = client.remote_pdo("RPDO", 1, objects=objects)          what the device has, with names
    client.send_pdo(rpdo, {"controlword": 15})
    client.pdos(tpdo1, tpdo2)                                     a stream of named values
    client.write_pdo(Pdo("TPDO", 1, (0x60410010,), type=1))       in the safe order

    client.fastscan(progress=print)                               the LSS functions under their own names

There is one LSS master on a bus, so of the LSS words one is said at a time, whoever says it.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, ParamSpec, TypeVar

from barewire import canopen
from barewire.canopen.cob_ids import cob_id
from barewire.canopen.lss import fastscan as lss_scan, master as lss_master
from barewire.io.canopen.operations import At, Talk, Verb, Watch, Watching, Words, say, sdo

if TYPE_CHECKING:
    from barewire.canopen import CanFrame, ObjectDictionary, PdoConfig, PdoConfigPolicy, PdoReceived, RemotePdo
    from barewire.canopen.pdo.config import PdoDirection
    from barewire.codecs import Value
    from barewire.conversation import Conversation
    from barewire.devices.device import Device

P = ParamSpec("P")
T = TypeVar("T")

LSS_HEARS = frozenset(
    {(cob_id("LSS answer"), False), *((0x700 + node, False) for node in range(1, 128))}
)  # answers, and who boots
LSS_CLAIM = frozenset({"LSS"})
_TYPES = {"u8": 1, "i8": 1, "u16": 2, "i16": 2, "u32": 4, "i32": 4, "f32": 4}


def objects_of(names: ObjectDictionary | Device | None) -> ObjectDictionary | None:
    """Names and types for the objects in a PDO: a dictionary, or what the description of a device says of them."""
    if names is None or isinstance(names, canopen.ObjectDictionary):
        return names
    entries: dict[tuple[int, int], canopen.Entry] = {}
    for parameter in names.parameters:
        place = parameter.object
        if place is not None and place.bit is None and parameter.type in _TYPES:
            entry = canopen.Entry(place.index, place.sub, parameter.name, parameter.type)
            entries.setdefault((place.index, place.sub), entry)
    return canopen.ObjectDictionary(entries.values())


class PdoVerbs(Words):
    """Process data of other nodes."""

    @Verb
    def read_pdo(
        self, direction: PdoDirection, number: int, *, node: At = None, timeout: float | None = None
    ) -> Talk[PdoConfig]:
        """One PDO of a device as its records say."""
        channel = self.channel(node)
        return sdo(channel, canopen.read_pdo(channel, direction, number, timeout=self.patience(timeout)))

    @Verb
    def write_pdo(
        self, pdo: PdoConfig, *, policy: PdoConfigPolicy | None = None, node: At = None, timeout: float | None = None
    ) -> Talk[None]:
        """Make a PDO of the device the one that is given, in the safe order. The device should be pre-operational."""
        channel = self.channel(node)
        return sdo(
            channel,
            canopen.write_pdo(channel, pdo, policy=policy or canopen.PdoConfigPolicy(), timeout=self.patience(timeout)),
        )

    @Verb
    def remote_pdo(
        self,
        direction: PdoDirection,
        number: int,
        *,
        objects: ObjectDictionary | Device | None = None,
        node: At = None,
        timeout: float | None = None,
    ) -> Talk[RemotePdo]:
        """One PDO of a device, with the names that a dictionary or a description has for its objects."""
        channel, known = self.channel(node), objects_of(objects)
        return sdo(channel, canopen.remote_pdo(channel, direction, number, known, timeout=self.patience(timeout)))

    @Verb
    def send_pdo(self, pdo: RemotePdo, values: Mapping[str, Value]) -> Talk[None]:
        """Values by name to an RPDO of a device. An object without a value goes as 0."""
        return say(pdo.encode(values))

    @Watching
    def pdos(self, *pdos: RemotePdo) -> Watch[PdoReceived]:
        """The values of these PDOs, as they come."""
        listener = canopen.PdoConsumer(pdos)
        return Watch(listener, frozenset(listener.sources))


def _lss(make: Callable[P, Conversation[CanFrame, T]]) -> Verb[P, T]:
    """A function of LSS as it stands: its parameters are the verb's."""

    def talk(client: Words, /, *args: P.args, **kwargs: P.kwargs) -> Talk[T]:
        return Talk(make(*args, **kwargs), LSS_CLAIM, LSS_HEARS)

    functools.update_wrapper(talk, make)
    return Verb(talk)


class LssVerbs(Words):
    """Node-IDs and bit rates over the bus itself."""

    switch_global = _lss(lss_master.switch_global)
    switch_selective = _lss(lss_master.switch_selective)
    identify_slaves = _lss(lss_master.identify_slaves)
    identify_unconfigured = _lss(lss_master.identify_unconfigured)
    inquire_address = _lss(lss_master.inquire_address)
    inquire_node = _lss(lss_master.inquire_node)
    configure_node = _lss(lss_master.configure_node)
    configure_bit_timing = _lss(lss_master.configure_bit_timing)
    activate_bit_timing = _lss(lss_master.activate_bit_timing)
    store_configuration = _lss(lss_master.store_configuration)
    fastscan = _lss(lss_scan.fastscan)
    find_all = _lss(lss_scan.assign_node_ids)
