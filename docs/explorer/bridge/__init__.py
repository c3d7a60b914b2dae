"""The Python side of the explorer: each view of the page asks for what it shows, and gets data for JSON.

    page (JavaScript)  --name, arguments as JSON-->  `call`  --{"result": ...} or {"error": text}-->  page

    guess     what a text or file is, and which view shows it
    frames    one frame: fields, verdict, diagnosis, pictures; a byte edited; the checksum mended
    log       a log: its lines, its faults, a sequence diagram
    steps     a checksum, a time, a value or a word worked out step by step
    values    registers as numbers of every type in every order
    eds       an electronic data sheet: its objects, what is wrong with it
    bench     a simulated CiA 402 drive with its frames

Everything is computed by the package itself. The files run in Pyodide in a worker of the browser, and in the tests on
any Python. Time is an argument: the page passes its clock.
"""

from __future__ import annotations

import json
from importlib import import_module

from barewire.errors import BarewireError

CALLS = {
    "guess": "guess",
    "eds": "eds",
    "style": "frames",
    "frame": "frames",
    "edit": "frames",
    "mend": "frames",
    "log": "log",
    "kinds": "steps",
    "steps": "steps",
    "values": "values",
    "placed": "values",
    "drive": "bench",
    "act": "bench",
    "sample": "bench",
}
"""What the page may ask for, and the file with the function. A file is loaded when a view needs it."""


def call(name: str, arguments: str) -> str:
    """Return the result of one call as JSON; `arguments` is a JSON object of its keyword arguments."""
    function = getattr(import_module(f"{__name__}.{CALLS[name]}"), name)
    try:
        return json.dumps({"result": function(**json.loads(arguments))}, ensure_ascii=False, default=str)
    except BarewireError as error:
        return json.dumps({"error": getattr(error, "text", None) or str(error)}, ensure_ascii=False)
