"""The adapter of barewire: answers the questions of the vectors as lines of JSON.

barewire vectors check --adapter "python vectors/examples/own.py"
"""

from __future__ import annotations

import json
import sys

import barewire
from barewire_workbench.vectors.answers.table import ANSWERS, own_answer

HELLO = {
    "name": "barewire",
    "version": barewire.__version__,
    "kinds": {kind: list(row) for kind, row in ANSWERS.items()},
}

for line in sys.stdin.buffer:
    question_id = None
    try:
        question = json.loads(line)
        if "hello" in question:
            answer = HELLO
        else:
            question_id = question["id"]
            answer = {"id": question_id, **own_answer(question)}
    except Exception as error:  # no question of the vectors, or a mistake of ours: it costs this question, not the run
        answer = {"id": question_id, "text": f"{type(error).__name__}: {error}"}
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()
