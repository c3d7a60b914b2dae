"""Which function runs which kind of vector."""

from __future__ import annotations

from collections.abc import Callable

from tests.vectors_runner import canopen, codecs, devices, lines, modbus, sdo_talk, services, talk
from tests.vectors_runner.common import Case

RUNNERS: dict[str, Callable[[Case], None]] = {
    "number": codecs.number,
    "bits": codecs.packed_bits,
    "register-part": codecs.register_part,
    "text": codecs.text,
    "pdu": modbus.pdu,
    "exchange": modbus.exchange,
    "crc16": lines.crc,
    "lrc": lines.lrc8,
    "rtu-timing": lines.timing,
    "rtu-frame": lines.rtu_frame,
    "ascii-frame": lines.ascii_frame,
    "tcp-frame": lines.tcp_frame,
    "rtu-talk": talk.rtu_talk,
    "ascii-talk": talk.ascii_talk,
    "tcp-talk": talk.tcp_talk,
    "can-text": canopen.can_text,
    "cob-id": canopen.cob_ids,
    "cob-restricted": canopen.cob_restricted,
    "cob-entry": canopen.cob_entry,
    "nmt": canopen.nmt,
    "node-state": canopen.node_state,
    "heartbeat-consumer": canopen.heartbeat_consumer,
    "sdo": canopen.sdo,
    "sdo-talk": sdo_talk.sdo_talk,
    "object-value": sdo_talk.object_value,
    "pdo": canopen.pdo,
    "emcy": canopen.emcy,
    "sync": canopen.sync,
    "time": services.time,
    "lss": services.lss,
    "node-talk": services.node_talk,
    "parameter": devices.parameter,
    "drive-state": devices.drive_state,
    "drive-command": devices.drive_command,
}
