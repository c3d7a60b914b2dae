"""Bytes from pasted text.

    hexdump           dumps of xxd, hexdump, od and tshark
    source_literals   byte arrays and strings of programming languages
    text              all of them, and plain hexadecimal: `parse_hex`, `parse_ascii`

Depends on: errors. Used by: explain.capture, explain.api.
"""
