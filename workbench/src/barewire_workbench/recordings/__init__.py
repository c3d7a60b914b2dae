"""Recordings of lines and buses, read and written. Bytes and text in, items out; no file access.

The files, in reading order:

    source           the bytes of a recording as they come, in parts of whole lines
    model            the items of a CAN recording; what is unread, what is left out
    capture          pcapng and pcap files; the frames of CAN and of Modbus in their packets
    candump          the notation of candump: its logs, and one frame, pasted
    can_texts        other CAN text: ASC, TRC, BUSMASTER, python-can, the conformance test tool of CiA, notes
    blf              Vector BLF, binary
    modbus_log/      recordings of Modbus in any form: logs of programs, exports, dumps, captures
    modbus_replay    any recording of Modbus, decoded by the sniffer
    modbus_writer    what the sniffer has seen, as a capture
"""
