"""Compose a new EDS from objects, or a DCF from an EDS.

compose(objects, file_info, device_info)  -> Eds    a new file
to_dcf(eds, 5, {"heartbeat time": 500})   -> Eds    the configuration of one device: ParameterValue keys, and
                                                    [DeviceComissioning]
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from barewire.canopen.cob_ids import check_node
from barewire.canopen.eds.edit import list_name, object_lines, pair_line, set_key
from barewire.canopen.eds.eds_file import Eds
from barewire.canopen.eds.lexer import EdsText
from barewire.canopen.eds.model import EdsItem, EdsObject, every_item
from barewire.canopen.eds.section_names import BAUD_RATES, COMMISSIONING, DEVICE_INFO, FILE_INFO, LISTS
from barewire.canopen.eds.value_syntax import Expression, Formula
from barewire.errors import EncodeError


def compose(
    objects: Iterable[EdsObject],
    file_info: Mapping[str, str] | None = None,
    device_info: Mapping[str, str] | None = None,
    *,
    comments: Iterable[str] = (),
    dummies: Iterable[int] = (),
    end: str = "\r\n",
    encoding: str = "ascii",
) -> Eds:
    """A new EDS. Keys of [FileInfo] and [DeviceInfo] that are not given are written without a value, or as 0.

    >>> heartbeat = EdsObject(0x1017, "Producer heartbeat time", 7, (EdsItem(0, "Producer heartbeat time", "u16"),))
    >>> eds = compose([heartbeat], {"FileName": "small.eds"}, {"VendorName": "Example"})
    >>> eds.diagnostics, eds.dictionary().entry(0x1017).type
    ((), 'u16')
    """
    described = sorted(objects, key=lambda one: one.index)
    lines = ["[FileInfo]"]
    lines += [pair_line(key, value) for key, value in (dict.fromkeys(FILE_INFO, "") | dict(file_info or {})).items()]
    lines += ["", "[DeviceInfo]"]
    info = {key: "" if key.endswith("Name") or key == "OrderCode" else "0" for key in DEVICE_INFO}
    lines += [pair_line(key, value) for key, value in (info | dict(device_info or {})).items()]
    lines += ["", "[DummyUsage]", *(f"Dummy{code:04X}={int(code in set(dummies))}" for code in range(1, 8))]
    text = list(comments)
    lines += ["", "[Comments]", f"Lines={len(text)}"]
    lines += [pair_line(f"Line{number}", line) for number, line in enumerate(text, 1)]
    for name in LISTS:
        listed = [one for one in described if list_name(one.index) == name]
        lines += ["", f"[{name}]", f"SupportedObjects={len(listed)}"]
        lines += [f"{number}=0x{one.index:04X}" for number, one in enumerate(listed, 1)]
        for one in listed:
            lines += object_lines(one)
    whole = "".join(line + end for line in lines)
    try:
        whole.encode(encoding)
    except UnicodeEncodeError as error:
        raise EncodeError(f"{error.object[error.start : error.end]!r} cannot be written in {encoding}") from None
    return Eds(EdsText(b"", encoding, whole))


def to_dcf(
    eds: Eds,
    node_id: int,
    values: Mapping[tuple[int, int] | str, Expression] | None = None,
    *,
    name: str = "",
    bitrate: int | None = None,
) -> Eds:
    """The configuration of one device of this EDS: a copy with [DeviceComissioning] and with values.

    Values are given by (index, sub-index) or by name; `bitrate` in bit/s. Raises EncodeError for a value outside of
    its data type or limits.
    """
    check_node(node_id)
    dcf = eds.copy()
    if bitrate is not None and f"BaudRate_{bitrate // 1000}" not in BAUD_RATES:
        raise EncodeError(f"{bitrate} bit/s: expected one of {', '.join(rate[9:] for rate in BAUD_RATES)} kbit/s")
    if (file_name := eds.get("FileInfo", "FileName")) is not None:
        dcf.put("FileInfo", "LastEDS", file_name)
    settings = {"NodeID": str(node_id), "NodeName": name, "Baudrate": str(bitrate // 1000) if bitrate else ""}
    for key in COMMISSIONING:
        if key == "Baudrate" and bitrate is None:
            continue  # not given
        if settings.get(key) or dcf.get("DeviceComissioning", key) is None:
            missing = "0" if key in ("NetNumber", "CANopenManager", "LSS_SerialNumber") else ""
            dcf.put("DeviceComissioning", key, settings.get(key) or missing)
    items = {(described.index, item.sub): (described, item) for described, item in every_item(eds.objects.values())}
    dictionary = eds.dictionary(node_id)
    for place, value in (values or {}).items():
        if isinstance(place, str):
            entry = dictionary.find(place)
            place = entry.index, entry.sub
        if place not in items:
            raise EncodeError(f"there is no object {place[0]:04X}h:{place[1]:02X}")
        described, item = items[place]
        _check_limits(item, place, value, node_id)
        set_key(dcf, described, item, "ParameterValue", value)
    return dcf


def _check_limits(item: EdsItem, place: tuple[int, int], value: Expression, node: int) -> None:
    number = value.at(node) if isinstance(value, Formula) else value
    if isinstance(number, (str, bytes)):
        return
    low, high = (limit.at(node) if isinstance(limit, Formula) else limit for limit in item.limits)
    if (low is not None and number < low) or (high is not None and number > high):
        reach = f"{'' if low is None else low}..{'' if high is None else high}"
        raise EncodeError(f"{place[0]:04X}h:{place[1]:02X} {item.name} = {number}: expected {reach}")
