"""The small edition: the stack for MicroPython, made from the sources.

    python -m tools.micropython build rtu client coils registers --out edition

    sources    the files as syntax trees, and what a name in them means
    seconds    time in whole microseconds
    patches    what no rule lowers, each with its reason
    lower      from the Python of CPython to that of MicroPython; classes: dataclasses, NamedTuples, enumerations
    reach      which definitions the chosen parts need
    build      the parts, and the files of an edition
    small/     what MicroPython lacks, and a table and ports of its own; it goes into an edition as it is

The standard `ast` reads and writes the code. It knows every construct of the Python that runs it, and needs nothing;
LibCST would also keep comments and blank lines, which have no place on a board. The rules are tested on CPython, for an
edition is a subset of Python (tests/micropython). `make micropython` runs the vectors on MicroPython:

    vectors    the vectors, from 0 on and from a clock that shows 30 days      answers, answer.mjs: inside MicroPython
    talks      with mbpoll and CPython on pseudo-terminals                     talk, talk.mjs: inside MicroPython
    sizes      bytes of bytecode, for docs/how-to/micropython.md; measure-memory, which is not a part of CI
"""
