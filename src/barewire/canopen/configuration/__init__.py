"""The configuration of a device from its DCF: compared, written in a safe order, and as a concise DCF.   [CiA 302, 306]

        DCF --device_configuration--> DeviceConfiguration --configure_device--> device
                                                          <--compare_device----

Files, in reading order:

    settings       the values of a DCF that are written, and those that identify the device
    configure      compare a device with them, and write what differs, in the order that the objects demand;
                   the same writes as the bytes of 1F22h, the concise DCF
"""
