"""What `barewire steps` cannot understand, and what pictures cannot be made of: rows of the tables in
tests/workbench/cli/test_wrong_options.py."""

from __future__ import annotations

WRONG_STEPS: list[tuple[tuple[str, ...], str]] = [
    (("steps", "crd", "02"), "did you mean 'crc'?"),
    (("steps", "crc"), "Missing argument 'HEX'; see barewire steps crc --help"),
    (("steps", "crc", "0G"), "'G' at 1 is not a hexadecimal digit"),
    (("steps", "crc", ""), "0 bytes: expected 1..256"),
    (("steps", "crc", "00" * 257), "257 bytes: expected 1..256"),
    (("steps", "crc", "00" * 9, "--view", "polynomial"), "the polynomial view has room for 8"),
    (("steps", "crc", "02", "--view", "tabel"), "did you mean 'table'?"),
    (("steps", "crc", "02", "--format", "jsn"), "did you mean 'json'?"),
    (("steps", "lrc", "x"), "'x' at 0 is not a hexadecimal digit"),
    (("steps", "timing", "--baudrate", "0"), "expected 1..100000000 bits per second"),
    (("steps", "timing", "--baudrate", "x"), "--baudrate"),
    *((("steps", "timing", "--format", text), "--format") for text in ("8X1", "jsn", "", "9E1")),
    (("steps", "float", "one"), "expected a number for f32"),
    (("steps", "float"), "expected a VALUE or --bytes HEX, one of them"),
    (("steps", "float", "1", "--bytes", "00"), "expected a VALUE or --bytes HEX, one of them"),
    (("steps", "float", "--bytes", "00"), "1 byte, but f32 has 4"),
    (("steps", "float", "--bytes", "0G"), "'G' at 1 is not a hexadecimal digit"),
    (("steps", "float", "1e99"), "does not fit f32"),
    (("steps", "float", "1", "--type", "f31"), "did you mean 'f32'"),
    (("steps", "float", "1", "--order", "ABDC"), "did you mean 'BADC'"),
    (("steps", "float", "70000", "--type", "u16"), "expected 0..65535"),
    (("steps", "cob-id", "5XY"), "expected up to 8 hexadecimal digits"),
    (("steps", "controlword", "12345"), "expected up to 4 hexadecimal digits"),
    (("steps", "controlword", "0F", "--previous", "x"), "--previous 'x': expected up to 4"),
    (("steps", "controlword", "0F", "--device", "az4"), "did you mean 'az3'?"),
    (("steps", "statusword", "0F", "--device", "adxl"), "adxl is not a drive"),
    (("steps", "crc", "02", "--format", "svg"), "steps crc has no picture: expected one of float, statusword,"),
    (("steps", "float", "1", "--type", "u16", "--format", "svg"), "a picture has two registers: expected one of f32"),
    (("steps", "can-frame", "705#05", "605#40", "--format", "svg"), "a picture has one frame, 2 are given"),
    (("steps", "statusword", "0250h", "x"), "expected up to 4 hexadecimal digits"),
    (("steps", "statusword"), "Missing argument 'WORD...'; see barewire steps statusword --help"),
    (("steps", "can-frame", "605#4"), "half a byte is left over"),
    (("steps", "can-frame", "605##140"), "is a CAN FD frame"),
    (("steps", "can-frame", *["001#"] * 9), "9 frames: expected 1..8"),
    (("steps", "can-frame", "605#40", "--bitrate", "0"), "expected 1..1000000 bit/s"),
]

_LONG = "9" * 5000
LONG_STEPS: list[tuple[str, ...]] = [
    *(("steps", name, _LONG) for name in ("crc", "float", "cob-id", "controlword", "statusword", "can-frame")),
    ("steps", "lrc", f"x{_LONG}"),
    ("steps", "float", _LONG, "--type", "u64"),
    ("steps", "timing", "--format", _LONG),
]

_EXPLAIN = ("explain", "rtu", "01")

WRONG_PICTURES: list[tuple[tuple[str, ...], str]] = [
    (("sniff", "tcp://127.0.0.1:1502", "--format", "svg"), "--format svg draws a recording"),
    (("sniff", "tcp://127.0.0.1:1502", "--picture", "states"), "--picture states draws a recording"),
    (("sniff", "bus.log", "--format", "html", "--write", "out.pcapng"), "--write is for frames"),
    (("sniff", "bus.log", "--picture", "state"), "did you mean 'states'?"),
    (("vectors", "show", "lrc-1", "--format", "svg"), "a case of kind lrc has no frames that can be drawn"),
    ((*_EXPLAIN, "--format", "svgg"), "did you mean 'svg'?"),
    ((*_EXPLAIN, "--json", "--format", "svg"), "--json and --format svg: give one of them"),
    ((*_EXPLAIN, "--picture", "level"), "did you mean 'levels'?"),
    ((*_EXPLAIN, "--line", "9600,8N1"), "--line is for the levels of rtu and ascii: add --picture levels"),
    ((*_EXPLAIN, "--picture", "fields", "--line", "9600,8N1"), "--line is for the levels of rtu and ascii"),
    (("explain", "rtu", "FF", "--picture", "levels", "--line", "9600,7E1"), "byte FFh does not fit the 7 data bits"),
    (("explain", "can", "605#40", "--picture", "levels", "--line", "9600,8N1"), "--line is for the levels of rtu"),
    (("explain", "tcp", "01", "--picture", "levels"), "a frame of tcp has only the picture fields"),
    (("explain", "can", "605##040", "--picture", "levels"), "a CAN FD or error frame has only the picture fields"),
    (("demo", "--format", "jsno"), "did you mean 'json'?"),
    *(
        ((*_EXPLAIN, "--picture", "levels", "--line", text), "such as")
        for text in ("9600", "x,8N1", "0,8N1", "9600,9N1")
    ),
]
