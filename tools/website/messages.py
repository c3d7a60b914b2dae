"""The pages of the messages: each with its drawing, its clause, and a frame explained byte by byte.

reference/messages-modbus.rst     every registered function code; the frames are cases of vectors/cases/modbus
reference/messages-canopen.rst    every service; the frames are the ones of EXAMPLES
"""

from __future__ import annotations

import json
from collections.abc import Iterator

from tools.website.docstrings import Link, clause, drawings, inline, rendered
from tools.website.source import ROOT, Module, Room, Thing

MODBUS_PATH = "reference/messages-modbus.rst"
CANOPEN_PATH = "reference/messages-canopen.rst"

_MODBUS_HEAD = """Modbus messages
===============

Every function code that barewire knows: what it is for, its bytes, its clause in the Modbus application protocol
(MB-APP), and one exchange with unit 1 on RTU. On TCP the same PDU stands behind an MBAP header, on ASCII as hexadecimal
characters. ``barewire explain rtu`` prints such a table for any frame.
"""

_CANOPEN_HEAD = """CANopen messages
================

Every service that barewire knows, with its bytes, its clause and example frames; ``can`` frames are written as
``identifier#data``. ``barewire explain can`` prints such a table for any frame.
"""

EXAMPLES = {
    "nmt.messages": ("000#0105", "705#00", "705#05"),
    "sync": ("080#", "080#01"),
    "time_stamp": ("100#00000000A42D",),
    "emcy": ("085#1023030000000000",),
    "sdo.messages": (
        *("605#4041600000000000", "585#4B41600037060000", "585#8041600000000206"),
        *("605#6000000000000000", "585#0354454D20415A00"),
        *("605#C600200115000000", "585#A40020017F000000"),
    ),
    "pdo.mapping": ("185#37061027",),
    "pdo.multiplexed": (),
    "lss.messages": ("7E5#0401000000000000", "7E5#1105000000000000"),
}
"""Files of `barewire.canopen` that define messages, in the order of the page, with frames to explain."""


class Messages:
    """Finds the classes of messages by name, and what a class without a drawing inherits."""

    def __init__(self, found: list[Room], link: Link) -> None:
        self.modules = {module.name: module for room in found for module in room.modules}
        self.classes = {thing.name: (module, thing) for module in self.modules.values() for thing in module.things}
        self.link = link

    def lines(self, name: str, mark: str) -> Iterator[str]:
        """Yield the section of one class."""
        module, thing = self.classes[name]
        title = f"{name}"
        yield from (title, mark * len(title), "", f":py:obj:`{module.name}.{name}`", "")
        yield from rendered(thing.docstring, self.link)
        if not drawings(thing.docstring):
            yield from self._inherited(thing)

    def _inherited(self, thing: Thing) -> Iterator[str]:
        for base in thing.bases:
            name = base.partition("[")[0]
            if name in self.classes and drawings(self.classes[name][1].docstring):
                yield from (f"The bytes are those of {inline(f'`{name}`', self.link)}:", "")
                for drawing in drawings(self.classes[name][1].docstring):
                    yield from (".. code-block:: text", "", *(f"   {line}".rstrip() for line in drawing), "")
                return

    def clause(self, name: str) -> str:
        """Return the clause of a class, its own or that of the class it derives from."""
        thing = self.classes[name][1]
        bases = [base.partition("[")[0] for base in thing.bases]
        return clause(thing.docstring) or next((self.clause(base) for base in bases if base in self.classes), "")


def examples() -> dict[str, dict[str, str]]:
    """Return by function (`03`, `2B 0E`) and side the first valid PDU of the vectors."""
    found: dict[str, dict[str, str]] = {}
    for file in sorted((ROOT / "vectors" / "cases" / "modbus").glob("fc*.json")):
        for case in json.loads(file.read_text(encoding="utf-8"))["cases"]:
            if case["result"] == "valid":
                pdu = str(case["pdu"])
                key = pdu[:5] if pdu.startswith("2B") else pdu[:2]
                found.setdefault(key, {}).setdefault(case["side"], pdu)
    return found


def modbus_page(found: list[Room], link: Link) -> str:
    """Return the page of the Modbus messages."""
    from barewire.modbus.messages.registry import known_requests

    messages, pdus = Messages(found, link), examples()
    lines = [
        _MODBUS_HEAD,
        ".. list-table::",
        "   :header-rows: 1",
        "",
        "   * - code",
        "     - function",
        "     - clause",
    ]
    sections: list[str] = []
    for request in known_requests():
        mei = getattr(request, "mei_type", None)
        code = f"{request.function_code:02X}" + ("" if mei is None else f" {mei:02X}")
        title = f"{code} {request.name}"
        lines += [f"   * - ``{code}``", f"     - `{title}`_", f"     - {messages.clause(request.__name__)}"]
        sections += ["", title, "-" * len(title), ""]
        sections += [*messages.lines(request.__name__, "~"), *messages.lines(request.response.__name__, "~")]
        for side, pdu in pdus.get(code, {}).items():
            sections += [*_explained("rtu", pdu, side)]
    title = "80 + code, the exception response"
    sections += ["", title, "-" * len(title), "", *messages.lines("ExceptionResponse", "~")]
    sections += _explained("rtu", "83 02", "response")
    return "\n".join([*lines, *sections]) + "\n"


def canopen_page(found: list[Room], link: Link) -> str:
    """Return the page of the CANopen messages."""
    messages = Messages(found, link)
    lines = [_CANOPEN_HEAD]
    for name, frames in EXAMPLES.items():
        module = messages.modules[f"barewire.canopen.{name}"]
        title = inline_title(module)
        lines += ["", title, "-" * len(title), "", f":py:mod:`{module.name}`", "", *rendered(module.docstring, link)]
        for thing in _messages_of(module):
            lines += messages.lines(thing.name, "~")
        for frame in frames:
            lines += _explained("can", frame, None)
    return "\n".join(lines) + "\n"


def inline_title(module: Module) -> str:
    """Return the title of a service: the words of its docstring before the colon."""
    return module.docstring.splitlines()[0].partition(":")[0].partition("   ")[0]


def _messages_of(module: Module) -> list[Thing]:
    """Return the classes that encode themselves, or derive from a class of the file that does."""
    found: list[Thing] = []
    for thing in module.things:
        methods = {member.name for member in thing.members}
        derives = any(base.startswith("_") or base in {other.name for other in found} for base in thing.bases)
        encodes = "encode" in methods and ("decode" in methods or drawings(thing.docstring))
        if thing.kind == "class" and (derives or encodes):
            found.append(thing)
    return found


def _explained(protocol: str, data: str, side: str | None) -> Iterator[str]:
    from barewire import rtu
    from barewire_workbench import explain_text

    text = rtu.encode(1, bytes.fromhex(data)).hex(" ").upper() if protocol == "rtu" else data
    explanation = explain_text(protocol, text, side)
    command = f'$ barewire explain {protocol} "{text}"' + (f" --role {side}" if side else "")
    yield from (".. code-block:: console", "", f"   {command}")
    yield from (f"   {line}".rstrip() for line in explanation.lines())
    yield ""
