"""What pictures cannot be made of: rows of the tables in tests/workbench/cli/test_wrong_options.py."""

from __future__ import annotations

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
