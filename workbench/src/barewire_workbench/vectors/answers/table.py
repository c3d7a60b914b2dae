"""`own_answer`: the answer of barewire to a question of the vectors."""

from __future__ import annotations

from collections.abc import Callable

from barewire.errors import DecodeError, EncodeError
from barewire_workbench.vectors.answers import (
    canopen,
    client,
    codecs,
    devices,
    frames,
    lines,
    messages,
    records,
    transfers,
)
from barewire_workbench.vectors.answers.modbus import conformance, gateways, servers
from barewire_workbench.vectors.answers.nodes import conformance as node_conformance, local, masters
from barewire_workbench.vectors.questions import Fields

ANSWERS: dict[str, dict[str, Callable[[Fields], Fields]]] = {
    "number": {"encode": codecs.encode_number, "decode": codecs.decode_number},
    "bits": {"encode": codecs.encode_bits, "decode": codecs.decode_bits},
    "register-part": {"encode": codecs.write_part, "decode": codecs.read_part},
    "text": {"encode": codecs.encode_characters, "decode": codecs.decode_characters},
    "pdu": {"encode": messages.encode_pdu, "decode": messages.decode_pdu},
    "exchange": {"decode": messages.accept},
    "gateway": {"run": gateways.route},
    "tls-role": {"decode": frames.role},
    "server": {"run": servers.serve},
    "server-conformance": {"run": conformance.answer_steps},
    "crc16": {"encode": frames.crc, "walk": frames.walk},
    "lrc": {"encode": frames.lrc8},
    "rtu-timing": {"encode": frames.timing},
    "rtu-frame": {"encode": frames.encode_rtu, "decode": frames.decode_rtu, "receive": frames.receive_rtu},
    "ascii-frame": {"encode": frames.encode_ascii, "decode": frames.decode_ascii, "receive": frames.receive_ascii},
    "tcp-frame": {"encode": frames.encode_tcp, "decode": frames.decode_tcp, "receive": frames.receive_tcp},
    "rtu-talk": {"run": lines.talk_rtu, "frames": lines.frames_only(lines.talk_rtu)},
    "ascii-talk": {"run": lines.talk_ascii, "frames": lines.frames_only(lines.talk_ascii)},
    "tcp-talk": {"run": lines.talk_tcp, "frames": lines.frames_only(lines.talk_tcp)},
    "client": {"run": client.run_client},
    "can-text": {"encode": canopen.write_can_text, "decode": canopen.read_can_text},
    "cob-id": {"encode": canopen.encode_cob_id, "decode": canopen.decode_cob_id},
    "cob-restricted": {"decode": canopen.restricted},
    "cob-entry": {"encode": canopen.encode_entry, "decode": canopen.decode_entry},
    "nmt": {"encode": canopen.encode_nmt, "decode": canopen.decode_nmt},
    "node-state": {"encode": canopen.encode_state, "decode": canopen.decode_state},
    "heartbeat-consumer": {"encode": canopen.encode_consumer, "decode": canopen.decode_consumer},
    "sdo": {"encode": canopen.encode_sdo, "decode": canopen.decode_sdo},
    "sdo-talk": {"client": transfers.client, "server": transfers.server},
    "object-value": {"encode": transfers.encode_object, "decode": transfers.decode_object},
    "pdo": {"encode": canopen.encode_pdo, "decode": canopen.decode_pdo},
    "emcy": {"encode": canopen.encode_emcy, "decode": canopen.decode_emcy},
    "sync": {"encode": canopen.encode_sync, "decode": canopen.decode_sync},
    "time": {"encode": canopen.encode_time, "decode": canopen.decode_time},
    "lss": {"encode": canopen.encode_lss, "decode": canopen.decode_lss},
    "node-talk": {"run": transfers.node},
    "device": {"run": local.device},
    "device-conformance": {"run": node_conformance.run_on_device},
    "heartbeat-watch": {"run": masters.watch},
    "lss-talk": {"run": masters.talk_lss},
    "boot-slave": {"run": masters.boot},
    "gateway-309-3": {"run": masters.talk_gateway},
    "mpdo": {"encode": records.encode_mpdo, "decode": records.decode_mpdo},
    "log-line": {"decode": records.read_lines},
    "eds": {"read": records.read_eds, "check": records.check_eds},
    "drive-path": {"decode": devices.drive_states, "encode": devices.drive_path},
    "parameter": {"encode": devices.encode_parameter, "decode": devices.decode_parameter},
    "drive-state": {"bits": devices.bits_of_word, "decode": devices.drive_state, "table": devices.state_table},
    "drive-command": {"decode": devices.is_command, "table": devices.command_table},
}
"""By kind and operation: the function that answers."""


def own_answer(question: Fields) -> Fields:
    """Return our answer to a question, in the form in which an adapter gives its answers."""
    function = ANSWERS.get(question["kind"], {}).get(question["do"])
    if function is None:
        return {"not_offered": f"barewire has no {question['kind']}.{question['do']}"}
    try:
        return {"is": function(question)}
    except EncodeError as error:
        return {"refused": "value", "text": str(error)}
    except DecodeError as error:
        return {"refused": error.reason, "text": str(error)}
