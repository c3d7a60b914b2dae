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
    registers    a 32-bit value in two registers, in four orders
    states       the state machine of CiA 402 with the path of a drive
    sequence     a sequence diagram
    exchanges    sequence diagrams of recordings
    drive_words  the status words and control words in a recording
    recordings   the picture of a recording
    steps_page   a calculation step by step as HTML
"""
