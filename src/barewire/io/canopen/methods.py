"""The words of CANopen that a master says most, once for both clients.

    client.upload(0x6041)                    -> b"7\\x06"          the blocking client
    await client.upload(0x6041)              -> b"7\\x06"          the asyncio client
    client.at(node=7).upload(0x6041)         another node of the same bus

Time-outs are those of the client where a call does not say otherwise; `node` is the client's where it does not, and may
be a `Channel` to another SDO server of a node. PDOs and LSS are in `can_verbs_more`.

What a word needs is loaded when it is said (`canopen.scan` is asked of the door): an upload loads no survey.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import TYPE_CHECKING, Any

from barewire import canopen
from barewire.canopen import download, upload, upload_to
from barewire.canopen.cob_ids import SYNC_KEY, TIME_KEY
from barewire.canopen.sdo.stream import LIMIT
from barewire.io.canopen.event_stream import Frames
from barewire.io.canopen.node_runner import CallbackAdapter
from barewire.io.canopen.operations import (
    NOBODY,
    SILENCE,
    At,
    Going,
    Talk,
    Verb,
    Watch,
    Watching,
    Words,
    described,
    dictionary,
    say,
    sdo,
)

if TYPE_CHECKING:
    from barewire.canopen.object_dictionary import ObjectRef
    from barewire.canopen.sdo.client.block_options import BlockMode
    from barewire.canopen.sdo.stream import SdoProgress
    from barewire.codecs import Value
    from barewire.devices.device import Device
    from barewire.devices.parameter import Reading
    from barewire.io.canopen.node_runner import Speaker
    from barewire.io.canopen.subscriber import Key

NODES = range(1, 128)
STATES = frozenset((0x700 + node, False) for node in NODES)


class MasterVerbs(Words):
    """SDO, NMT, error control, EMCY, SYNC, TIME, and who is there."""

    # SDO

    @Verb
    def upload(
        self,
        index: int,
        sub: int = 0,
        *,
        size: int | None = None,
        node: At = None,
        block: BlockMode = False,
        limit: int | None = LIMIT,
        progress: SdoProgress | None = None,
        timeout: float | None = None,
    ) -> Talk[bytes]:
        """Read an object: its bytes, little-endian. `block` may be True, False, "auto" or a `BlockSettings`;
        `progress(done, size)` is told how it goes. Raises SdoAbort, NoAnswer, PortError."""
        channel, wait = self.channel(node), self.patience(timeout)
        how: dict[str, Any] = {"size": size, "block": block, "limit": limit, "progress": progress, "timeout": wait}
        return sdo(channel, upload(channel, index, sub, **how))

    @Verb
    def upload_to(
        self,
        index: int,
        sub: int,
        sink: Callable[[bytes], object],
        *,
        node: At = None,
        block: BlockMode = "auto",
        progress: SdoProgress | None = None,
        timeout: float | None = None,
    ) -> Talk[int]:
        """Read an object of any length into `sink`, part by part; the result is how many bytes there were."""
        channel, wait = self.channel(node), self.patience(timeout)
        how: dict[str, Any] = {"block": block, "progress": progress, "timeout": wait}
        return sdo(channel, upload_to(channel, index, sub, sink, **how))

    @Verb
    def download(
        self,
        index: int,
        sub: int,
        data: bytes | Iterable[bytes],
        *,
        size: int | None = None,
        node: At = None,
        block: BlockMode = False,
        progress: SdoProgress | None = None,
        timeout: float | None = None,
    ) -> Talk[None]:
        """Write an object: its bytes, little-endian, as many as its type has. `data` may also be pieces, taken as they
        are sent; then `size` is how many bytes they are together, if anybody knows. Never repeated."""
        channel, wait = self.channel(node), self.patience(timeout)
        how: dict[str, Any] = {"size": size, "block": block, "progress": progress, "timeout": wait}
        return sdo(channel, download(channel, index, sub, data, **how))

    @Verb
    def find_channel(self, server: int, *, node: At = None, timeout: float | None = None) -> Talk[canopen.Channel]:
        """The channel to a further SDO server of a node, for the `node` of other verbs. Server 1 is the default one."""
        from barewire.canopen.sdo.client.find_channel import find_channel

        channel = self.channel(node)
        return sdo(channel, find_channel(channel, server, timeout=self.patience(timeout)))

    # Values

    @Verb
    def read_object(
        self,
        objects: canopen.ObjectDictionary,
        place: ObjectRef,
        *,
        node: At = None,
        block: BlockMode = False,
        timeout: float | None = None,
    ) -> Talk[Value]:
        """The value of an object, which `objects` knows by name, by index, or by (index, sub-index)."""
        channel, wait = self.channel(node), self.patience(timeout)
        return sdo(channel, canopen.read_object(channel, dictionary(objects), place, block=block, timeout=wait))

    @Verb
    def write_object(
        self,
        objects: canopen.ObjectDictionary,
        place: ObjectRef,
        value: Value,
        *,
        node: At = None,
        block: BlockMode = False,
        timeout: float | None = None,
    ) -> Talk[None]:
        """Give an object this value, in the type that `objects` has for it. Never repeated."""
        channel, wait = self.channel(node), self.patience(timeout)
        return sdo(channel, canopen.write_object(channel, dictionary(objects), place, value, block=block, timeout=wait))

    @Verb
    def read(self, device: Device, *names: str, node: At = None) -> Talk[list[Reading]]:
        """Named values of a described device, in the order asked."""
        from barewire.devices.canopen_access import read_canopen

        described(device, names)
        channel = self.channel(node, device)
        return sdo(channel, read_canopen(channel, device, names, timeout=self.timeout))

    @Verb
    def write(self, device: Device, values: Mapping[str, Value], *, node: At = None, force: bool = False) -> Talk[None]:
        """Write named values of a described device, in the order given. Ranges and access are checked before anything
        is sent."""
        from barewire.devices.canopen_access import write_canopen

        described(device, values)
        channel = self.channel(node, device)
        return sdo(channel, write_canopen(channel, device, values, timeout=self.timeout, force=force))

    # NMT and error control

    @Verb
    def command(self, command: canopen.NmtCommand, *, node: int | None = None) -> Talk[None]:
        """Send an NMT command to the node, or with `node=0` to all. It is not confirmed: `tell_nmt` is."""
        return say(canopen.NmtMessage(command, self.node_id(node)).encode())

    @Verb
    def tell_nmt(
        self,
        command: canopen.NmtCommand,
        *,
        node: int | None = None,
        confirmed_by: Iterable[int] | None = None,
        timeout: float = 2.0,
        ask_every: float | None = None,
    ) -> Talk[list[canopen.NmtConfirmation]]:
        """Send an NMT command and wait until the node, or every node of `confirmed_by`, says that it is there."""
        at = self.node_id(node)
        telling = canopen.send_nmt(command, at, confirmed_by=confirmed_by, timeout=timeout, ask_every=ask_every)
        return Talk(telling, NOBODY, STATES)

    @Verb
    def ask_state(self, *, node: int | None = None, timeout: float = 0.5) -> Talk[canopen.NodeState]:
        """The state of a node, asked by node guarding."""
        return Talk(canopen.request_state(self.node_id(node), timeout=timeout), NOBODY, STATES)

    @Verb
    def wait_for_boot_up(self, *, node: int | None = None, timeout: float = 10.0) -> Talk[canopen.NodeState]:
        """Wait for the boot-up message of the node."""
        return Talk(canopen.wait_for_boot_up(self.node_id(node), timeout=timeout), NOBODY, STATES)

    @Verb
    def wait_for_heartbeat(self, *, node: int | None = None, timeout: float = 10.0) -> Talk[canopen.NodeState]:
        """Wait for the next heartbeat of the node."""
        return Talk(canopen.wait_for_heartbeat(self.node_id(node), timeout=timeout), NOBODY, STATES)

    @Verb
    def wait_for_state(self, *states: int, node: int | None = None, timeout: float = 10.0) -> Talk[canopen.NodeState]:
        """Wait for a heartbeat that says that the node is in one of these states."""
        return Talk(canopen.wait_for_state(self.node_id(node), states, timeout=timeout), NOBODY, STATES)

    @Watching
    def heartbeats(self, times: Mapping[int, float] | None = None) -> Watch[canopen.HeartbeatEvent]:
        """Who boots, who is alive, who changes its state; and for the nodes of `times`, who is silent for so long."""
        return Watch(canopen.HeartbeatConsumer(times or {}), STATES)

    @Going
    def start_guarding(
        self, guards: Mapping[int, canopen.Guard], tell: Callable[[canopen.GuardEvent], object]
    ) -> tuple[Speaker, frozenset[Key]]:
        """Guard nodes the older way, by asking each in its time, until it is stopped. `tell` is called with what
        changes, in the thread or task that asks."""
        return CallbackAdapter(canopen.GuardingMaster(guards, time.monotonic()), tell), STATES

    # EMCY, SYNC, TIME

    @Watching
    def emergencies(self, cob_ids: Mapping[Key, int] | None = None) -> Watch[canopen.EmcyEvent]:
        """What goes wrong in the nodes. `cob_ids` tells whose emergencies have another identifier than 80h + node."""
        keys = {(0x80 + node, False) for node in NODES} | STATES | set(cob_ids or ())
        return Watch(canopen.EmcyConsumer(cob_ids), frozenset(keys))

    @Verb
    def send_sync(self, counter: int | None = None, *, key: Key = SYNC_KEY) -> Talk[None]:
        """One SYNC. `key` is its (identifier, extended) where 1005h of the devices says another than 80h."""
        return say(canopen.SyncMessage(counter).encode(key))

    @Going
    def start_sync(self, period: float, *, overflow: int = 0, key: Key = SYNC_KEY) -> tuple[Speaker, frozenset[Key]]:
        """Be the SYNC producer: a beat every `period` seconds, counting up to `overflow`, until it is stopped."""
        return canopen.SyncProducer(period, overflow=overflow, key=key), SILENCE

    @Watching
    def syncs(
        self, period: float | None = None, *, overflow: int | None = None, key: Key = SYNC_KEY
    ) -> Watch[canopen.SyncEvent]:
        """The beats of somebody else, as `SyncMonitor` judges them."""
        return Watch(canopen.SyncMonitor(period, overflow=overflow, key=key), frozenset({key}))

    @Verb
    def send_time(self, unix: float | None = None, *, key: Key = TIME_KEY) -> Talk[None]:
        """One TIME message: the time of this machine, or the one given in seconds since 1 January 1970. `key` is its
        (identifier, extended) where 1012h of the devices says another than 100h."""
        stamp = canopen.TimeStamp.of_unix(time.time() if unix is None else unix)
        return say(stamp.encode(key))

    @Going
    def start_time(self, period: float, *, key: Key = TIME_KEY) -> tuple[Speaker, frozenset[Key]]:
        """Say the time of this machine at once and every `period` seconds, until it is stopped."""
        return canopen.TimeProducer(period, time.time() - time.monotonic(), key=key), SILENCE

    @Watching
    def times(self, *, key: Key = TIME_KEY) -> Watch[canopen.TimeReceived]:
        """The TIME messages of somebody else."""
        return Watch(canopen.TimeConsumer(key), frozenset({key}))

    # Anything

    @Verb
    def send(self, frame: canopen.CanFrame) -> Talk[None]:
        """Put one frame on the bus."""
        return say(frame)

    @Watching
    def frames(self, *keys: Key) -> Watch[canopen.CanFrame]:
        """All frames, or those with these identifiers, as they come."""
        return Watch(Frames(), frozenset(keys) or None)

    @Going
    def host(self, node: Speaker) -> tuple[Speaker, None]:
        """Let a node of our own live on this bus, until it is stopped: a `LocalNode`, or any machine of frames."""
        return node, None

    @Verb
    def scan(
        self,
        nodes: Collection[int] = NODES,
        *,
        listen: float = 0.0,
        timeout: float = 0.1,
        progress: Callable[[int, canopen.ScanResult], None] | None = None,
    ) -> Talk[canopen.ScanResult]:
        """Who is on the bus, and why we believe it. Transfers of others of us with these nodes are waited for."""
        claims = frozenset(("SDO", 0x580 + node, False) for node in nodes)
        return Talk(canopen.scan(nodes, listen=listen, timeout=timeout, progress=progress), claims, None)
