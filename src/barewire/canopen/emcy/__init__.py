"""EMCY: emergency messages about errors of a device.   [CiA 301, EMCY]

The files, in reading order:

        message      the message, the meaning of its error codes and of the error register
        consumer     the active errors of other nodes
        producer     the errors of this device: messages, register 1001h, history 1003h
"""
