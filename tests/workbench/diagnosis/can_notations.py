"""Traffic of a CAN bus in the notations in which people post it. Each writer takes frames, and returns lines."""

from __future__ import annotations

from collections.abc import Callable

from barewire.canopen.frame import AnyFrame, ErrorFrame

_ERROR_FLAG = 0x2000_0000


def _number(frame: AnyFrame) -> int:
    return frame.classes | _ERROR_FLAG if isinstance(frame, ErrorFrame) else frame.id


def _id(frame: AnyFrame) -> str:
    is_long = isinstance(frame, ErrorFrame) or frame.extended
    return f"{_number(frame):0{8 if is_long else 3}X}"


def _0x(data: bytes) -> str:
    return ", ".join(f"0x{byte:02X}" for byte in data)


CAN_NOTATIONS: dict[str, Callable[[AnyFrame], str]] = {
    "candump": lambda frame: f"  can0  {_id(frame)}   [{len(frame.data)}]  {frame.data.hex(' ').upper()}",
    "candump -L": lambda frame: f"(1700000000.5) can0 {_id(frame)}#{frame.data.hex()}",
    "hash": lambda frame: f"{_id(frame)}#{frame.data.hex().upper()}",
    "hash in a message": lambda frame: f"[ WARN] [1690188601.97]: received frame: {_id(frame)}#{frame.data.hex()}",
    "brackets": lambda frame: f"{_id(frame)}   [{len(frame.data)}]  {frame.data.hex(' ')}",
    "ID and data": lambda frame: f"ID: 0x{_number(frame):X} Data: {frame.data.hex(' ').upper()}",
    "printf": lambda frame: f"RX id=0x{_number(frame):03x} len={len(frame.data)} data={frame.data.hex(' ')}\r",
    "STM32": lambda frame: f"StdId: 0x{_number(frame):X}, DLC: {len(frame.data)}, Data: {_0x(frame.data)}",
    "Message(...)": lambda frame: (
        f"can.Message(timestamp=1.5, arbitration_id=0x{_number(frame):x}, is_extended_id=False, "
        f"dlc={len(frame.data)}, data=[{_0x(frame.data)}])"
    ),
    "JSON": lambda frame: f'{{"id":{_number(frame)},"len":{len(frame.data)},"data":{[*frame.data, 255][:-1]}}}',
    "two lines": lambda frame: f"COB-ID: 0x{_number(frame):X}\nData: {frame.data.hex(' ')}",
    "PCAN trace": lambda frame: f"    30)      2427.0  Rx     {_id(frame)}  {len(frame.data)}  {frame.data.hex(' ')} ",
    "PCAN-View": lambda frame: f"{_id(frame)}h   {len(frame.data)}   {frame.data.hex(' ').upper()}",
    "table": lambda frame: f"| {_id(frame)} | {len(frame.data)} | {frame.data.hex(' ')} |",
    "socket error": lambda frame: (
        f"canopend[99]: socket msg ID: 0x{_number(frame):08X}, Data[0..7]: {_0x(frame.data)} (can0)"
    ),
    "gs_usb": lambda frame: (
        f"ffffffff{_number(frame).to_bytes(4, 'little').hex()}{len(frame.data):02x}000000{frame.data.hex():0<16}"
    ),
    "directed": lambda frame: f"15:47:14.042 CAN1 {_id(frame)} Tx SD {len(frame.data)} {frame.data.hex(' ')}",
}


def posted(frames: list[AnyFrame], notation: str) -> str:
    """Return a text that somebody posts: a sentence, the frames in this notation, and a question.

    >>> from barewire.canopen import CanFrame
    >>> posted([CanFrame.parse("705#05")], "hash").splitlines()[2]
    '705#05'
    """
    lines = map(CAN_NOTATIONS[notation], frames)
    return "\n".join(["The drive does not start. This is what I see since 2024-05-01:", "", *lines, "", "Why is that?"])
