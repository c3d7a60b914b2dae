"""Pictures of frames, lines, exchanges, drives and values: as text, JSON, SVG and HTML from the same data.

    barewire explain rtu "01 03 00 00 00 02 C4 0B" --format svg > frame.svg

The files in reading order:

    colours      the colours, light and dark, and the style sheet
    drawing      elements of SVG; waves in characters
    picture      what every picture has; SVG files and HTML pages
    fields       the bytes of a frame and what they mean
    levels       the levels of characters on a serial line
    can_frame    the bits of a CAN frame
    frames       the pictures of one frame

Depends on: result, wire, rtu. No ports, files or clocks. Used by: cli, the explorer, tests.
"""
