"""`own_answer`: the answer of barewire to a question of the vectors."""

from __future__ import annotations

from barewire.errors import DecodeError, EncodeError
from barewire_workbench.vectors.answers import canopen, client, device_conformance, modbus, nodes, servers, values
from barewire_workbench.vectors.answers.values import Answers
from barewire_workbench.vectors.questions import Fields

ANSWERS: Answers = {
    kind: row
    for file in (values, modbus, servers, client, canopen, nodes, device_conformance)
    for kind, row in file.ANSWERS.items()
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
