"""Sniffers: machines that pair the requests and responses of other stations.

    sniffer     for serial lines, whose frames show neither their direction nor the request they answer
    numbered    for TCP connections, whose responses carry the number of their request

Depends on: modbus.framing, modbus.messages. Used by: io.modbus.sniff, explain.
"""
