"""Answers the questions of the vectors with one vendored file, where neither barewire nor another library is installed.

    python -I adapter.py FILE NAME FOLDER BAREWIRE KIND,KIND,...

FOLDER and BAREWIRE are the folders of the sources of `barewire_workbench` and `barewire`. The workbench's own answers
run, and whatever they import of barewire is looked up in FILE by its name; of the folder of barewire only the names of
its modules are read. What FILE does not have raises NotInFile when it is used: the question is then not offered.
"""

from __future__ import annotations

import json
import os
import sys
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import module_from_spec, spec_from_file_location
from inspect import signature
from itertools import count
from types import ModuleType
from typing import Any, get_args


class NotInFile(Exception):
    """A question needs what the file does not have."""


class _Missing(type):
    """The type of the classes that stand for what the file does not have: they can be named and inherited from."""

    def __call__(cls, *arguments: object, **named: object) -> Any:
        raise NotInFile(f"the file has no {cls.__name__}")

    def __getattr__(cls, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return _missing(f"{cls.__name__}.{name}")

    def __iter__(cls) -> Any:
        return iter(())


def _missing(name: str) -> Any:
    return _Missing(name, (), {})


class _Names(ModuleType):
    """A module of barewire, whose names are those of the file."""

    vendored: Any
    folder: str

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        if os.path.exists(f"{self.folder}/{name}.py") or os.path.isdir(f"{self.folder}/{name}"):
            __import__(f"{self.__name__}.{name}")
            return sys.modules[f"{self.__name__}.{name}"]
        return getattr(self.vendored, name, None) or _missing(name)


class Finder(MetaPathFinder, Loader):
    """Finds the modules of barewire in the file, and those of the workbench in their folder."""

    def __init__(self, vendored: ModuleType, workbench: str, barewire: str) -> None:
        self.vendored = vendored
        self.folders = {"barewire": barewire, "barewire_workbench": workbench}

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        """Return how a module of ours is loaded."""
        house, *rest = name.split(".")
        if house not in self.folders:
            return None
        place = "/".join([self.folders[house], *rest])
        is_package = os.path.isdir(place)
        if house == "barewire":
            return ModuleSpec(name, self, is_package=is_package)
        if not rest or rest == ["vectors"] or rest == ["vectors", "answers"] or rest == ["conform"]:
            return ModuleSpec(name, self, is_package=True)  # nothing of the packages themselves is needed
        source = f"{place}/__init__.py" if is_package else f"{place}.py"
        return spec_from_file_location(name, source, submodule_search_locations=[place] if is_package else None)

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Return a module whose names are those of the file."""
        module = _Names(spec.name)
        house, *rest = spec.name.split(".")
        module.folder = "/".join([self.folders[house], *rest])
        module.vendored = self.vendored
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Do nothing: names are looked up when they are needed."""


def add_stand_ins(vendored: Any) -> None:
    """Give a file what only the questions need: messages by their code, one connection without others."""
    classes: list[Any] = [cls for cls in vars(vendored).values() if isinstance(cls, type)]
    requests = [cls for cls in classes if issubclass(cls, vendored.Request) and hasattr(cls, "response")]
    by_code = {_code(cls): cls for cls in requests if hasattr(cls, "function_code")}

    def decode_request(pdu: bytes) -> Any:
        return (by_code.get(_code_in(pdu)) or _missing(f"request {pdu[:1].hex()}")).decode(pdu)

    def response_class(pdu: bytes) -> Any:
        request = by_code.get(_code_in(pdu))
        if pdu[:1] >= b"\x80":
            return getattr(vendored, "ExceptionResponse", None) or _missing("ExceptionResponse")
        return request and request.response

    def decode(frame: bytes) -> Any:
        """Decode a request that the client has sent over TCP."""
        return vendored.Adu(frame[6], frame[7:], int.from_bytes(frame[:2], "big"))

    class OneConnection:
        """In place of `FanOut`, for a client with one request at a time."""

        def __init__(self, at_once: int, first_number: int = 1) -> None:
            if at_once > 1 or not hasattr(vendored, "TcpLine"):
                raise NotInFile("the file has no FanOut")
            numbers = count(first_number)
            self.lines = [vendored.TcpLine(number=lambda: next(numbers) & 0xFFFF)]

        def feed(self, data: bytes) -> list[tuple[int, bytes]]:
            return [(0, data)]

    if hasattr(vendored, "RtuLine") and not hasattr(vendored, "Role"):
        own_line = vendored.RtuLine
        vendored.RtuLine = lambda timing, role="client", units=(), patience=0.03: own_line(timing, patience=patience)
    if hasattr(vendored, "Table"):
        vendored.Table = _table_of(vendored)
    if hasattr(vendored, "TcpLine") and not hasattr(vendored.TcpLine, "sent"):
        vendored.TcpLine.sent = lambda line, now: None
    stand_ins = {
        "decode_request": decode_request,
        "decode_response": lambda pdu: (response_class(pdu) or _missing(f"response {pdu[:1].hex()}")).decode(pdu),
        "request_class": lambda pdu: by_code.get(_code_in(pdu)),
        "response_class": response_class,
        "FanOut": OneConnection,
        "decode": decode,
    }
    for name, stand_in in stand_ins.items():
        if not hasattr(vendored, name):
            setattr(vendored, name, stand_in)


def add_sdo_stand_ins(vendored: Any) -> None:
    """Let the transfers of a file be called as those of barewire: for a node, with options that it does not have."""
    own_upload, own_download = vendored.upload, vendored.download

    def upload(node: int, index: int, sub: int, *, block: object = False) -> Any:
        if block:
            raise NotInFile("the file has no block transfers")
        return own_upload(vendored.Channel(node), index, sub)

    def download(node: int, index: int, sub: int, data: bytes, *, indicated: bool, block: object = False) -> Any:
        if block or not indicated:
            raise NotInFile("the file has no block transfers, and states each size")
        return own_download(vendored.Channel(node), index, sub, data)

    vendored.upload, vendored.download = upload, download


def _table_of(vendored: Any) -> Any:
    """Return the table of the file, which passes over arguments for families that the file does not have."""
    known = signature(vendored.Table).parameters

    class Table(vendored.Table):  # type: ignore[misc]  # of a file that is not known here
        def __init__(self, *arguments: Any, **named: Any) -> None:
            super().__init__(*arguments, **{name: value for name, value in named.items() if name in known})

    return Table


_MEI = 0x2B00
"""Function 2B has a second byte, which selects the function."""
_EXTENDED_EXCEPTION = 0xAB


def _code(message: Any) -> int:
    """Return the function code of a message class, of function 2B with the second byte."""
    number: int | None = getattr(message, "mei_type", None)
    return int(message.function_code) if number is None else _MEI | number


def _code_in(pdu: bytes) -> int:
    """Return the function code of a PDU, of function 2B with the second byte; 0 for an empty one."""
    return _MEI | pdu[1] if pdu[:1] == b"\x2b" and len(pdu) > 1 else (pdu or b"\0")[0]


_STANDARD = frozenset((*range(0x01, 0x09), 0x0B, 0x0C, 0x0F, 0x10, 0x11, *range(0x14, 0x19), 0x2B))
"""The function codes of the standard. One of them that is not in a file is as unknown to it as any other code."""


class Limits:
    """What a file is for: the questions about anything else are not put to it."""

    def __init__(self, vendored: Any) -> None:
        classes: list[Any] = [cls for cls in vars(vendored).values() if isinstance(cls, type)]
        codes = {_code(cls) for cls in classes if isinstance(getattr(cls, "function_code", None), int)}
        # The probe of a client is one sub-function of 08, and not the message.
        self._codes = codes if hasattr(vendored, "SUB_FUNCTIONS") else codes - {0x08}
        self._roles = get_args(getattr(vendored, "Role", None)) or ("client",)
        self._decodes = hasattr(vendored, "decode")

    def excludes(self, question: dict[str, Any]) -> str:
        """Return why a question is not put to the file; an empty text for one that is."""
        kind, do, line = question["kind"], question["do"], question.get("line")
        role = line.get("role") if isinstance(line, dict) else None
        if kind == "rtu-frame" and do == "receive":
            role = "client" if question["side"] == "response" else "server"
        if role is not None and role not in self._roles:
            return f"the file has no line of a {role}"
        if do == "decode" and kind.endswith("-frame") and not self._decodes:
            return "the file decodes frames in a stream only"
        for code in self._codes_of(question):
            if code not in self._codes and (code in _STANDARD or code == _EXTENDED_EXCEPTION or code >= _MEI):
                return f"the file has no function {code:02X}"
        return ""

    @staticmethod
    def _codes_of(question: dict[str, Any]) -> list[int]:
        """Return the function codes of a question."""
        kind = question["kind"]
        if kind == "client":
            texts = [ask["pdu"] for ask in question["ask"]]
        elif kind == "server":
            texts = [step["ask"] for step in question["talk"] if "ask" in step]
        elif kind == "rtu-frame" and question["do"] == "receive":
            received = " ".join(question["pieces"])
            texts = [received[2:], *(["AB"] if "AB FF" in received else [])]  # the code is behind the unit
        elif kind in ("pdu", "exchange"):
            texts = [question[field] for field in ("function", "pdu", "request") if field in question]
        else:
            return []
        return [_code_in(data) for text in texts if (data := bytes.fromhex(text))]


def main(file: str, name: str, workbench: str, barewire: str, kinds: str) -> None:
    """Answer questions until the input ends."""
    spec = spec_from_file_location("vendored", file)
    assert spec is not None and spec.loader is not None  # noqa: PT018
    vendored = module_from_spec(spec)
    sys.modules["vendored"] = vendored
    spec.loader.exec_module(vendored)
    limits = Limits(vendored)
    if hasattr(vendored, "Request"):
        add_stand_ins(vendored)
    if hasattr(vendored, "SdoClient"):
        add_sdo_stand_ins(vendored)
    sys.meta_path.insert(0, Finder(vendored, workbench, barewire))
    answers: dict[str, dict[str, Any]] = {}
    for part in ("modbus", "servers", "client", "canopen", "nodes"):
        try:
            module = __import__(f"barewire_workbench.vectors.answers.{part}", fromlist=["ANSWERS"])
        except NotInFile:
            continue  # it makes something of what the file does not have when it is loaded
        answers |= {kind: row for kind, row in module.ANSWERS.items() if kind in kinds.split(",")}
    for line in sys.stdin:
        question = json.loads(line)
        if "hello" in question:
            answer: dict[str, Any] = {"name": name, "kinds": {kind: list(row) for kind, row in answers.items()}}
        elif why := limits.excludes(question):
            answer = {"id": question["id"], "not_offered": why}
        else:
            answer = {"id": question["id"], **_answer(vendored, answers[question["kind"]][question["do"]], question)}
        sys.stdout.write(json.dumps(answer) + "\n")
        sys.stdout.flush()


def _answer(vendored: Any, function: Any, question: dict[str, Any]) -> dict[str, Any]:
    try:
        return {"is": function(question)}
    except NotInFile as missing:
        return {"not_offered": str(missing)}
    except vendored.EncodeError as error:
        return {"refused": "value", "text": str(error)}
    except vendored.DecodeError as error:
        return {"refused": error.reason, "text": str(error)}


if __name__ == "__main__":
    main(*sys.argv[1:])
