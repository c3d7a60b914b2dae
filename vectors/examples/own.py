"""The adapter of barewire: answers the questions of the vectors as lines of JSON.

barewire vectors check --adapter "python vectors/examples/own.py"
"""

from __future__ import annotations

import json
import sys

import barewire
from barewire_workbench.vectors.answers.table import ANSWERS, own_answer

KINDS = {kind: list(row) for kind, row in ANSWERS.items()}

for line in sys.stdin:
    question = json.loads(line)
    if "hello" in question:
        answer = {"name": "barewire", "version": barewire.__version__, "kinds": KINDS}
    else:
        answer = {"id": question["id"], **own_answer(question)}
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()
