"""A node with its DCF, the configuration of one device: `bus.node(5, dcf="pump.dcf")`.   [CiA 302, 306]

    node.diff()                  what the device has, and what the DCF says
    node.configure(store=True)   write the differences, read them back, stamp 1020h with the date of the DCF
    node.read("Heartbeat")       values by name, as with an EDS

The conversations are those of `canopen.configuration`; both clients carry them out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from barewire._html import html_table
from barewire.canopen.configuration.configure import (
    ConfigurationResult,
    ConfigureProgress,
    compare_device,
    configure_device,
)
from barewire.canopen.configuration.settings import (
    DeviceConfiguration,
    Difference,
    device_configuration,
    object_text,
    value_text,
)
from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.dialect import SdoDialect
from barewire.conversation import Conversation
from barewire.io.canopen.methods.operations import BusOperation, R, operation, sdo_transfer
from barewire.io.canopen.node import EdsNode, check_node_id, parsed_eds

if TYPE_CHECKING:
    from pathlib import Path

    from barewire.canopen.eds.eds_file import Eds
    from barewire.canopen.object_dictionary import ObjectDictionary


class Differences(list[Difference]):
    """The differences between a device and its configuration, in the order of the objects. A notebook shows them as a
    table."""

    def _repr_html_(self) -> str:
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
        wait = self.timeout if timeout is None else timeout
        configuring = configure_device(
            self.channel, self.configuration, store=store, dry_run=dry_run, timeout=wait, progress=progress
        )
        return sdo_transfer(self.channel, configuring, wait)


def _differences(comparing: Conversation[CanFrame, list[Difference]]) -> Conversation[CanFrame, Differences]:
    return Differences((yield from comparing))


def dcf_node(runner: R, number: int | None, dcf: str | Path | Eds, **settings: Any) -> DcfNode[R]:
    """Return the node of a DCF. Its number is by default that of the file.

    Raises EncodeError for a file that cannot be read, that has no node-ID while none is given, or that is an EDS.
    """
    parsed = parsed_eds(dcf, "dcf")
    configuration = device_configuration(parsed, None if number is None else check_node_id(number))
    return DcfNode(runner, configuration.node, parsed.dictionary(configuration.node), configuration, **settings)
