"""Values of machines to an MQTT broker: polled by name, buffered on disk, published in order; commands the other way.

    machine  ->  poll  ->  changed?  ->  Buffer (SQLite)  ->  broker         barewire/SITE/MACHINE/PARAMETER
    machine  <-  write, only what the configuration allows <-  broker        barewire/SITE/MACHINE/PARAMETER/set

In reading order:

    schedule     when which parameters are read, and which values are worth publishing; time is an argument
    buffer       readings that the broker has not acknowledged, in a file of bounded size
    messages     topics, payloads, and the discovery of Home Assistant
    publisher    the tasks: one for each line, one for the broker

It needs aiomqtt, which is based on paho-mqtt: `pip install barewire[publish]`.
"""
