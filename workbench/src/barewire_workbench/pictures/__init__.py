"""Pictures of frames, lines, exchanges, drives and values: as text, JSON, SVG and HTML from the same data.

    barewire explain rtu "01 03 00 00 00 02 C4 0B" --format svg > frame.svg

The files in reading order:

    drawing      the colours, the style sheet, the elements of SVG, waves in characters
    picture      what every picture has; SVG files and HTML pages
    fields       the bytes of a frame and what they mean
    levels       the levels of characters on a serial line, the bits of a CAN frame
    steps        a 32-bit value in two registers; a calculation step by step as HTML
    states       the state machine of CiA 402 with the path of a drive
    sequence     a sequence diagram
    recordings   the sequence diagram of a recording, and the words of the drives in it
"""
