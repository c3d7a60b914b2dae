"""The reference as an adapter: answers the questions of the vectors as lines of JSON.

barewire vectors check --adapter "python vectors/reference/main.py"

It shows what each kind demands, in the simplest way, for somebody who writes it in another language. It is slow.
"""

import json
import sys

import can_frames
import checks
import client
import devices
import exchange
import frames
import lines
import node_talk
import pdo
import pdu
import sdo
import sdo_client
import sdo_server
import server
import services
import values
from texts import Refused

MODULES = (
    *(values, checks, pdu, exchange, frames, lines, client),
    *(can_frames, services, sdo, sdo_client, sdo_server, pdo, node_talk, devices, server),
)
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
