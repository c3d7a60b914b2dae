"""`barewire steps`: a checksum, a time, a value or a word, worked out step by step.

Each command makes one value, `Steps`, which is printed as text or JSON. `--format svg` draws some of them, and
`--format html` has the picture above the calculation:

    float                        the bytes of a 32-bit value in two registers, in the four orders
    statusword, controlword      the state machine of CiA 402 with the words
    can-frame                    the bits of one frame on the bus
    timing                       the levels of a request with the silence around it
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

import click

from barewire.ascii import encode as ascii_frame
from barewire.canopen.frame import CanFrame
from barewire.codecs.order import ORDERS
from barewire.devices import Device, load
from barewire.errors import DecodeError, EncodeError
from barewire.rtu import encode as rtu_frame
from barewire_workbench.cli.arguments import Choice, CommandGroup, json_option
from barewire_workbench.cli.output import Output, output_form
from barewire_workbench.frames.input import parse_ascii, parse_hex
from barewire_workbench.pictures.levels import CanFramePicture, LevelsPicture
from barewire_workbench.pictures.picture import Picture, rendered
from barewire_workbench.pictures.states import DriveWord, StatesPicture
from barewire_workbench.pictures.steps import TYPES, RegistersPicture
from barewire_workbench.recordings.candump import parse_can
from barewire_workbench.steps import (
    CRC_VIEWS,
    NUMBER_TYPES,
    Steps,
    can_frame_steps,
    cob_id_steps,
    control_word_steps,
    crc_steps,
    lrc_steps,
    number_from_bytes_steps,
    number_steps,
    parse_cob_id,
    parse_word,
    status_word_steps,
    timing_steps,
)
from barewire_workbench.wire import CharacterFormat, can_bits

_FORMS = ("text", "json", "html", "svg")

_form_option = click.option(
    "--format", "form", type=Choice(_FORMS), help="The form of the output; --json is json, text is the default."
)
_device_option = click.option("--device", metavar="NAME", help="Names of the bits from this drive: az3, csd-mt, ...")


def _print_steps(steps: Steps | Picture, form: str, draw: Callable[[], Picture]) -> None:
    """Print a calculation, or a picture, in a form of output. A page has the picture above the calculation, if any."""
    if isinstance(steps, Picture):
        print(rendered(form, steps), end="")
    elif form == "html":
        from barewire_workbench.pictures.steps import StepsPage

        pictures: list[Picture] = []
        with suppress(EncodeError):
            pictures.append(draw())
        print(rendered(form, *pictures, StepsPage(steps)), end="")
    else:
        Output(form).show("\n".join(steps.lines()), steps.as_dict)


@click.group("steps", cls=CommandGroup)
def steps_command() -> None:
    """Work out a checksum, a time, a value or a word step by step.

    \b
    barewire steps crc "02 07"
    barewire steps lrc "01 04 00 00 08"
    barewire steps timing --baudrate 19200 --format 8E1
    barewire steps float 1.1 --order CDAB
    barewire steps float --bytes "CC CD 3F 8C" --order CDAB
    barewire steps cob-id 58Fh
    barewire steps controlword 000Fh
    barewire steps statusword 0637h --device az3
    barewire steps statusword 0250h 0231h 0233h 0237h --format svg
    barewire steps can-frame "605#4041600000000000" --bitrate 500000
    barewire steps can-frame "705#05" "605#40"
    """


def _command(name: str, *, dashes: bool = False) -> Callable[[Callable[..., Steps | Picture]], click.Command]:
    """Make a command of a function that returns the steps, or only a picture.

    With `dashes` an argument may begin with one, as -5.
    """

    def make(function: Callable[..., Steps | Picture]) -> click.Command:
        def run(as_json: bool, form: str | None, **arguments: Any) -> None:
            chosen = output_form(form, as_json=as_json)
            try:
                steps = _picture(name, arguments) if chosen == "svg" else function(**arguments)
                _print_steps(steps, chosen, lambda: _picture(name, arguments))
            except DecodeError as error:
                raise click.UsageError(error.text) from None

        run.__doc__ = function.__doc__
        run.__click_params__ = getattr(function, "__click_params__", [])  # type: ignore[attr-defined]
        settings = {"ignore_unknown_options": True} if dashes else {}
        return steps_command.command(name, context_settings=settings)(json_option(_form_option(run)))

    return make


@_command("crc")
@click.argument("data", nargs=-1, required=True, metavar="HEX")
@click.option(
    "--view", "views", type=Choice(CRC_VIEWS), multiple=True, help="One view only; may be given more than once."
)
def crc_command(data: tuple[str, ...], views: tuple[str, ...]) -> Steps:
    """The CRC of RTU: shift register, byte table, polynomials."""
    chosen = [view for view in CRC_VIEWS if view in views or not views]
    return crc_steps(parse_hex(" ".join(data)), chosen)


@_command("lrc")
@click.argument("data", nargs=-1, required=True, metavar="HEX")
def lrc_command(data: tuple[str, ...]) -> Steps:
    """The LRC of ASCII: the sum and its two's complement.

    HEX may be an ASCII frame from the colon on; its last byte is then the LRC.
    """
    typed = parse_ascii(" ".join(data))
    if typed.startswith(b":"):
        return lrc_steps(parse_hex(typed[1:].rstrip(b"\r\n").decode("latin-1")))
    return lrc_steps(parse_hex(" ".join(data)))


@_command("float", dashes=True)
@click.argument("value", required=False)
@click.option("--type", "type_name", type=Choice(NUMBER_TYPES), default="f32", show_default=True)
@click.option("--order", type=Choice(ORDERS), default="ABCD", show_default=True, help="A: the most significant byte.")
@click.option("--bytes", "data", metavar="HEX", help="The way back: the number in these bytes, instead of VALUE.")
def float_command(value: str | None, type_name: str, order: Any, data: str | None) -> Steps:
    """A number in registers, in the four byte orders.

    A float has a sign, an exponent and a fraction, and is rounded; an integer may have a two's complement.
    """
    _check_value_or_bytes(value, data)
    if data is not None:
        return number_from_bytes_steps(parse_hex(data), type_name, order)
    return number_steps(value or "", type_name, order)


@_command("cob-id")
@click.argument("cob_id")
@click.option("--extended", is_flag=True, help="An identifier of 29 bits, although 11 would be enough.")
def cob_id_command(cob_id: str, extended: bool) -> Steps:
    """A COB-ID in hexadecimal: service and node.

    Above 7FFh it has 29 bits; above 1FFFFFFFh it is an entry of the object dictionary with flags in bits 29 to 31.
    """
    return cob_id_steps(parse_cob_id(cob_id), extended=extended)


@_command("controlword")
@click.argument("word", required=False)
@click.option("--previous", default="0000", show_default=True, help="The word before: fault reset is an edge.")
@_device_option
def controlword_command(word: str | None, previous: str, device: str | None) -> Steps:
    """A control word of CiA 402: bits and command.

    WORD is hexadecimal. What it does depends on the state of the drive. Without WORD, all commands and transitions.
    """
    number = None if word is None else parse_word(word, "control word")
    return control_word_steps(number, parse_word(previous, "--previous"), _drive(device))


@_command("statusword")
@click.argument("words", nargs=-1, required=True, metavar="WORD...")
@_device_option
def statusword_command(words: tuple[str, ...], device: str | None) -> Steps | Picture:
    """A status word of CiA 402: bits and state.

    WORD is hexadecimal. The next control words are those that lead to an enabled drive. Of several words, which a
    drive has sent one after the other, the states and the transitions between them.
    """
    known = _drive(device)
    if len(words) > 1:
        return _picture("statusword", {"words": words, "device": device})
    return status_word_steps(parse_word(words[0], "status word"), known)


def _drive(name: str | None) -> Device | None:
    return None if name is None else load(name)


@_command("can-frame")
@click.argument("frames", nargs=-1, required=True, metavar="FRAME...")
@click.option("--bitrate", type=int, default=125_000, show_default=True, help="Bits per second.")
def can_frame_command(frames: tuple[str, ...], bitrate: int) -> Steps:
    """A CAN frame bit by bit, or the arbitration of several.

    FRAME is what candump prints. Of one frame the fields, the CRC-15, the stuff bits and the duration are worked out.
    """
    return can_frame_steps(_typed_frames(frames), bitrate)


def _typed_frames(words: tuple[str, ...]) -> list[CanFrame]:
    # can0 605#40 and 605 40 41 60 without quotes are one frame each.
    texts = words if sum("#" in word for word in words) > 1 else (" ".join(words),)
    return [parse_can(text) for text in texts]


@steps_command.command("timing")
@click.option("--baudrate", type=int, default=19200, show_default=True, help="Bits per second.")
@click.option(
    "--format",
    "forms",
    multiple=True,
    metavar="8E1|text|json|html|svg",
    help="The form of a character (8E1 by default), and that of the output; may be given twice.",
)
@json_option
def timing_command(baudrate: int, forms: tuple[str, ...], as_json: bool) -> None:
    """The times of a serial line: t1.5, t3.5, exchanges."""
    outputs = [form for form in forms if form in _FORMS]
    characters = [form for form in forms if form not in _FORMS]
    if len(outputs) > 1 or len(characters) > 1:
        raise EncodeError(f"--format {' --format '.join(forms)}: expected one form of a character, one of the output")
    chosen = output_form(outputs[0] if outputs else None, as_json=as_json)
    try:
        character = CharacterFormat.parse(characters[0] if characters else "8E1")
    except EncodeError as error:
        raise EncodeError(f"--format: {error}; or {', '.join(_FORMS)}") from None
    steps = timing_steps(baudrate, character)
    picture = _timing_picture(baudrate, character)
    _print_steps(picture if chosen == "svg" else steps, chosen, lambda: picture)


# The pictures


def _picture(name: str, arguments: Mapping[str, Any]) -> Picture:
    """Return the picture of a command with these arguments. Raise EncodeError if it has none."""
    draw = _DRAWN.get(name)
    if draw is None:
        raise EncodeError(f"steps {name} has no picture: expected one of {', '.join(_DRAWN)}")
    return draw(**arguments)


def _timing_picture(baudrate: int, character: CharacterFormat) -> LevelsPicture:
    """Return the levels of a request: of RTU with the silence around it, with 7 data bits of ASCII."""
    pdu = bytes.fromhex("03 00 00 00 02")
    if character.data_bits < 8:
        digits = ["unit", "function code", "address", "address", "quantity", "quantity", "LRC"]
        names = ["start", *(name for name in digits for _ in range(2)), "CR", "LF"]
        return LevelsPicture(ascii_frame(1, pdu), character, baudrate, names)
    request = rtu_frame(1, pdu)
    names = ["unit", "function code", "address", "address", "quantity", "quantity", "CRC", "CRC"]
    return LevelsPicture(request, character, baudrate, names, "t3.5")


def _check_value_or_bytes(value: str | None, data: str | None) -> None:
    """Raise EncodeError unless a number is given in one way: as VALUE or as its bytes."""
    if (value is None) == (data is None):
        raise EncodeError("expected a VALUE or --bytes HEX, one of them; see barewire steps float --help")


def _registers(value: str | None, type_name: str, order: str, data: str | None) -> Picture:
    _check_value_or_bytes(value, data)
    if type_name not in TYPES:
        raise EncodeError(f"--type {type_name}: a picture has two registers: expected one of {', '.join(TYPES)}")
    if value is None:
        return RegistersPicture.of_bytes(parse_hex(data or ""), type_name, order=order)
    steps = number_steps(value, type_name, "ABCD")
    number = steps.values["value"]
    if type_name == "f32":
        with suppress(ValueError):
            number = float(value)  # as it was given, before it is rounded
    if not isinstance(number, int | float):
        number = RegistersPicture.of_bytes(bytes.fromhex(str(steps.values["bytes"])), type_name).rows[0].value
    return RegistersPicture.of_value(number, type_name, order=order)


def _control_word(word: str | None, previous: str, device: str | None) -> Picture:
    words = [] if word is None else [DriveWord("control", parse_word(word, "control word"))]
    before = parse_word(previous, "--previous")
    return StatesPicture([*([DriveWord("control", before)] if before else []), *words], device or "")


def _status_word(words: Sequence[str], device: str | None) -> Picture:
    return StatesPicture((DriveWord("status", parse_word(word, "status word")) for word in words), device or "")


def _can_frame(frames: tuple[str, ...], bitrate: int) -> Picture:
    frame, *others = _typed_frames(frames)
    if others:
        raise EncodeError(f"a picture has one frame, {1 + len(others)} are given")
    return CanFramePicture(can_bits(frame), bitrate)


_DRAWN: dict[str, Callable[..., Picture]] = {
    "float": _registers,
    "statusword": _status_word,
    "controlword": _control_word,
    "can-frame": _can_frame,
}
