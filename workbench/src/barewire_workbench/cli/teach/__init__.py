"""Commands that teach the wire by hand.

The files, in reading order:

    send     `send`: the bytes of a frame as they are; the answer, explained
    steps    `steps`: checksums, times, values and words, worked out step by step
    shown_frames   the frames of a command as they pass: `--frames` of read, write, drive and demo
    drawings the pictures of `steps`
    lab      `lab`: the labs of the course, and the checks of their answers
    labs     the labs, one file each (a folder)
"""
