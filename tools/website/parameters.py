"""The pages of the devices: every parameter of a description, by the headings that `barewire devices NAME` has too.

reference/devices-adxl.md    name, type and unit, range, default, access, where it is, its values and bits
"""

from __future__ import annotations

from collections.abc import Iterator

ERRATA = {
    "az3-modbus.md": ("az3", "the Modbus guide"),
    "az3-canopen.md": ("az3", "the CANopen guide"),
    "adxl.md": ("adxl", "the addendum"),
    "csd-mt.md": ("csd-mt", "the manual"),
}
"""The pages of docs/reference/errata: the device and its manual."""

_COLUMNS = ("parameter", "type", "unit", "range", "default", "access", "Modbus", "CANopen", "notes")


def pages() -> dict[str, str]:
    """Return the page of each device of the catalogue by path."""
    from barewire.devices import names

    return {f"reference/devices-{name}.md": page(name) for name in names()}


def page(name: str) -> str:
    """Return the page of one device."""
    from barewire.devices import Parameter, load

    device = load(name)
    groups: dict[str, list[Parameter]] = {}
    heading = "Parameters"
    for parameter in device.parameters:
        heading = parameter.group or heading
        groups.setdefault(heading, []).append(parameter)
    lines = [f"# {device.title}", "", f"`{name}`: {len(device.parameters)} parameters, made of the", ""]
    lines[2] += " [description](device-description.md) of the catalogue. `barewire devices " + name
    lines[2] += " --json` has the same as JSON. Modbus addresses are those on the wire, counted from 0."
    errata = [f"[{title}](errata/{file})" for file, (device_name, title) in ERRATA.items() if device_name == name]
    lines += [f"What the manual prints otherwise: {', '.join(errata)}.", ""] if errata else []
    for title, rows in groups.items():
        lines += [f"## {title}", "", *table([_cells(row) for row in rows]), ""]
    return "\n".join(lines)


def table(rows: list[tuple[str, ...]]) -> Iterator[str]:
    """Yield a Markdown table without the columns that are empty."""
    kept = [at for at in range(len(_COLUMNS)) if any(row[at] for row in rows)]
    yield f"| {' | '.join(_COLUMNS[at] for at in kept)} |"
    yield f"|{'---|' * len(kept)}"
    for row in rows:
        yield f"| {' | '.join(row[at] for at in kept)} |"


def _cells(parameter: object) -> tuple[str, ...]:
    from barewire.devices import Parameter

    assert isinstance(parameter, Parameter)
    limits = [parameter.minimum, parameter.maximum]
    shown = ["" if each is None else _number(each) for each in limits]
    span = shown[0] if shown[0] == shown[1] else " to ".join(shown)
    scale = "" if parameter.scale == 1 else f" × {parameter.scale}"
    return (
        f"**{_text(parameter.name)}**",
        parameter.type + scale,
        _text(parameter.unit),
        span,
        "" if parameter.default is None else _text(str(parameter.default)),
        parameter.access,
        *parameter.places,
        _notes(parameter.values, parameter.bits, parameter.note),
    )


def _number(value: int | float) -> str:
    """Return a limit without an exponent if it is a whole number."""
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else f"{value:g}"


def _notes(values: object, bits: object, note: str) -> str:
    def listed(table: object, word: str) -> Iterator[str]:
        if isinstance(table, dict) or hasattr(table, "items"):
            for number, text in table.items():
                yield f"{word}{number}: {_text(str(text))}"

    return "<br>".join(filter(None, ["<br>".join(listed(values, "")), "<br>".join(listed(bits, "bit ")), _text(note)]))


def _text(text: str) -> str:
    """Return plain text for a cell of a Markdown table."""
    for sign in "\\*_`[]<>|":
        text = text.replace(sign, f"\\{sign}")
    return " ".join(text.split())
