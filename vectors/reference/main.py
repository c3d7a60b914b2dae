"""The reference as an adapter: answers the questions of the vectors as lines of JSON.

barewire vectors check --adapter "python vectors/reference/main.py"

It shows what each kind demands, in the simplest way, for somebody who writes it in another language. It is slow.
"""

import json
import sys
from pathlib import Path

from texts import Refused

FOLDERS = ("modbus", "canopen", "device")
sys.path += [str(Path(__file__).parent / folder) for folder in FOLDERS]

NAMES = (
    *("values", "devices", "drive_path", "log_lines"),
    *("checks", "pdu", "exchange", "frames", "lines", "client", "server", "gateway", "tls_role"),
    *("can_frames", "services", "sdo", "sdo_client", "sdo_server", "pdo", "node_talk", "heartbeat_watch", "lss_talk"),
    *("boot_slave", "gateway_309_3", "eds", "device"),
)
MODULES = [__import__(name) for name in NAMES]
KINDS: dict = {}
for module in MODULES:
    for kind, operations in module.KINDS.items():
        KINDS.setdefault(kind, {}).update(operations)


def answer(question):
    """Return the answer to a question: fields, or a refusal with its reason."""
    try:
        return {"is": KINDS[question["kind"]][question["do"]](question)}
    except Refused as refused:
        return {"refused": refused.args[0]}


def main():
    """Answer each line of the standard input."""
    for line in sys.stdin:
        question = json.loads(line)
        if "hello" in question:
            kinds = {kind: list(operations) for kind, operations in KINDS.items()}
            reply = {"name": "reference", "version": "1", "kinds": kinds}
        else:
            reply = {"id": question["id"], **answer(question)}
        sys.stdout.write(json.dumps(reply) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
