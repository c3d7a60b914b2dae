"""The answers of the small edition to the questions of the vectors: ours, lowered with it, and run in MicroPython."""

from __future__ import annotations

import json
import sys
from typing import Any

from barewire.conversation import Listen
from barewire.errors import DecodeError, EncodeError
from barewire_workbench.vectors.answers import canopen, client, modbus, nodes, servers, values

TABLES = (values.ANSWERS, modbus.ANSWERS, servers.ANSWERS, client.ANSWERS, canopen.ANSWERS, nodes.ANSWERS)
_INFINITE = (float("inf"), float("-inf"))


class WrongTime(Exception):
    """A time that is no whole number: it would be rounded where floats have 32 bits."""


def _check_time(listen: Listen, until: float) -> None:
    if isinstance(until, float) and until not in _INFINITE:
        raise WrongTime(str(until))
    listen.until = until  # type: ignore[misc]  # here it is a class like others


def kinds() -> str:
    """Return the kinds and operations that are offered, as JSON. From here on a wrong time is an error."""
    Listen.__init__ = _check_time  # type: ignore[method-assign, assignment]
    return json.dumps({kind: list(row) for table in TABLES for kind, row in table.items()})


def serve() -> None:
    """Answer the questions that come as lines, where MicroPython is a program with a standard input."""
    for line in sys.stdin:
        hello = {"name": "barewire on MicroPython", "version": sys.version, "kinds": json.loads(kinds())}
        sys.stdout.write((json.dumps(hello) if "hello" in json.loads(line) else answer(line)) + "\n")


def _is_beyond_table(question: dict[str, Any]) -> bool:
    """Whether a server is asked what the small table does not have: 07, 11, 14, 15, 18 and 2B."""
    asks = [step["ask"][:2] for step in question.get("talk", ()) if question["kind"] == "server" and "ask" in step]
    return any(ask in ("07", "11", "14", "15", "18", "2B") for ask in asks)


def answer(line: str) -> str:
    """Return the answer to a question, both as JSON."""
    question = json.loads(line)
    of_kind = [table[question["kind"]] for table in TABLES if question["kind"] in table]
    reply: dict[str, Any]
    try:
        if not of_kind or question["do"] not in of_kind[0] or _is_beyond_table(question):
            reply = {"not_offered": "not in this edition"}
        else:
            reply = {"is": of_kind[0][question["do"]](question)}
    except EncodeError as error:
        reply = {"refused": "value", "text": str(error)}
    except DecodeError as error:
        reply = {"refused": error.reason, "text": str(error)}
    except NotImplementedError as error:
        reply = {"not_offered": str(error)}
    except Exception as error:  # the next question may fare better
        reply = {"failed": f"{type(error).__name__}: {error}"}
    reply["id"] = question["id"]
    return json.dumps(reply)
