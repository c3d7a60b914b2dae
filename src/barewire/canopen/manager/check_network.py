"""The dry run of a boot-up: what a manager would find and write, without an NMT command and without a write."""

from __future__ import annotations

from collections.abc import Callable

from barewire.canopen.frame import CanFrame
from barewire.canopen.manager.boot_events import NetworkBoot
from barewire.canopen.manager.boot_slave import BootProgress, boot_slave
from barewire.canopen.manager.network_list import NetworkList, checked_network
from barewire.canopen.sdo import Channel
from barewire.conversation import DEFAULT_TIMEOUT, Conversation


def check_network(
    network: NetworkList,
    *,
    timeout: float = DEFAULT_TIMEOUT,
    channels: Callable[[int], Channel] = Channel,
    progress: BootProgress | None = None,
) -> Conversation[CanFrame, NetworkBoot]:
    """Check each node as `boot_network` does, one after the other, and write nothing. Return a result for each node,
    whose `planned` says what would be written, and whether the network could become ready."""
    results = []
    for slave in checked_network(network).slaves:
        checking = boot_slave(slave, channels(slave.node), timeout=timeout, progress=progress, dry_run=True)
        results.append((yield from checking))
    failed = {result.node for result in results if not result.ok}
    return NetworkBoot(not any(slave.mandatory and slave.node in failed for slave in network.slaves), tuple(results))
