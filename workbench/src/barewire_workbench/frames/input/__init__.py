"""Bytes from pasted text.

The files, in reading order:

    hexdump           dumps of xxd, hexdump, od and tshark
    source_literals   byte arrays and strings of programming languages
    text              all of them, and plain hexadecimal: `parse_hex`, `parse_ascii`
"""
