"""The pages of the API: one for each room of both packages, made of the docstrings.

    reference/api/index.rst            the front door
    reference/api/modbus.client.rst    barewire.modbus.client: the room, then its files in reading order
    reference/api/workbench.steps.rst  barewire_workbench.steps

Every public object is one of Sphinx's Python domain, so that the search finds it by name, and `Bus` in backticks is a
link: a public name has one meaning in the whole package.
"""

from __future__ import annotations

from collections.abc import Iterator

from tools.rooms import HOUSES, ROOT
from tools.website.docstrings import Link, inline, rendered, summary
from tools.website.source import Module, Room, Thing

FOLDER = "reference/api"
_SELF_EVIDENT = ("name", "function_code", "layout")
"""Class variables of a message that its drawing shows."""


def page_of(room: str) -> str:
    """Return the page of a room, without the ending.

    >>> page_of("barewire.modbus.client"), page_of("barewire"), page_of("barewire_workbench.steps")
    ('reference/api/modbus.client', 'reference/api/index', 'reference/api/workbench.steps')
    """
    return f"{FOLDER}/{room.removeprefix('barewire').removeprefix('.').removeprefix('_') or 'index'}"


def names(found: list[Room]) -> dict[str, str]:
    """Return the full name of each public class, function and value; of a name with two meanings none."""
    known: dict[str, str] = {}
    twice = set()
    for room in found:
        for module in room.modules:
            for thing in module.things:
                if thing.name in known:
                    twice.add(thing.name)
                known[thing.name] = f"{module.name}.{thing.name}"
                if thing.kind in ("class", "exception"):
                    for member in thing.members:
                        if _shown(member):
                            known[f"{thing.name}.{member.name}"] = f"{module.name}.{thing.name}.{member.name}"
    return {name: full for name, full in known.items() if name.partition(".")[0] not in twice}


def linker(found: list[Room]) -> Link:
    """Return the function that finds the full name of what stands in backticks in a docstring."""
    known = names(found)
    modules = {module.name for room in found for module in room.modules} | {room.name for room in found}

    def link(name: str) -> str | None:
        plain = name.removesuffix("()")
        for candidate in (plain, *(f"{package}.{plain}" for package in HOUSES)):
            if candidate in modules:
                return candidate
        return known.get(plain.removeprefix("barewire."))

    return link


def pages(found: list[Room], link: Link) -> dict[str, str]:
    """Return the pages of the API by path."""
    things = [(module, thing) for room in found for module in room.modules for thing in module.things]
    summaries = {f"{module.name}.{thing.name}": summary(thing.docstring) for module, thing in things if thing.docstring}
    return {f"{page_of(room.name)}.rst": "\n".join(_room_lines(room, link, summaries)) + "\n" for room in found}


def _room_lines(room: Room, link: Link, summaries: dict[str, str]) -> Iterator[str]:
    title = room.name
    yield from (title, "=" * len(title), "", f".. py:module:: {room.name}", "")
    yield from rendered(room.docstring, link)
    if room.rooms:
        top = room.name in HOUSES
        yield from (".. toctree::", "   :maxdepth: 1", *(["   :titlesonly:"] if top else []), "")
        yield from (f"   {name.rpartition('.')[2]} <{page_of(name).rpartition('/')[2]}>" for name in room.rooms)
        yield ""
    yield from _offer_lines(room, link, summaries)
    for module in room.modules:
        yield from _module_lines(module, link)


def _offer_lines(room: Room, link: Link, summaries: dict[str, str]) -> Iterator[str]:
    """Yield what may be imported from the room: at the front door with a sentence for each name."""
    known = {name: full for name, full in room.offers.items() if full in summaries}
    if room.name in HOUSES:
        yield from ("The front door", "--------------", "")
        for name, full in known.items():
            yield from (f":py:obj:`{name} <{full}>`", f"   {inline(summaries[full], link)}", "")
    elif known:
        yield from (f"From ``{room.name}`` itself: {', '.join(f':py:obj:`{n} <{f}>`' for n, f in known.items())}.", "")


def _module_lines(module: Module, link: Link) -> Iterator[str]:
    yield from ("", module.name.rpartition(".")[2], "-" * len(module.name), "")
    where = module.file.relative_to(ROOT).as_posix()
    yield from (f".. py:module:: {module.name}", "", f"``{where}``", "")
    yield from rendered(module.docstring, link)
    named = [thing.name for thing in module.things if thing.docstring or thing.kind != "data"]
    if named:
        yield from (f"Defines {', '.join(inline(f'`{name}`', link) for name in named)}.", "")
    for thing in module.things:
        if thing.docstring or thing.kind != "data":
            yield from _thing_lines(thing, link, 0)


def _shown(member: Thing) -> bool:
    return bool(member.docstring) and member.name not in _SELF_EVIDENT


def _thing_lines(thing: Thing, link: Link, depth: int) -> Iterator[str]:
    indent = "   " * depth
    signature = " ".join(thing.signature.split())
    options: list[str] = []
    if thing.kind in ("attribute", "data", "property"):
        annotation, _, value = signature.removeprefix(":").partition(" = ")
        if annotation.strip() and "\\" not in annotation:
            options.append(f":type: {annotation.strip()}")
        if value and "\\" not in value and thing.kind != "property":
            options.append(f":value: {value}")
        signature = ""
    if thing.is_async:
        options.append(":async:")
    options += [f":{word}:" for word in ("classmethod", "staticmethod") if word in thing.decorators]
    yield f"{indent}.. py:{thing.kind}:: {thing.name}{escape_signature(signature)}"
    yield from (f"{indent}   {option}" for option in options)
    yield ""
    if thing.bases and thing.kind in ("class", "exception"):
        bases = ", ".join(inline(f"`{base}`", link) for base in thing.bases)
        yield from (f"{indent}   Bases: {bases}", "")
    yield from (f"{indent}   {line}".rstrip() for line in rendered(thing.docstring, link))
    for member in thing.members:
        if _shown(member):
            yield from _thing_lines(member, link, depth + 1)


def escape_signature(signature: str) -> str:
    """Return a signature as the argument of a directive: Sphinx takes a backslash off."""
    return signature.replace("\\", "\\\\")
