"""Conformance of CANopen devices: cases as data, and a conversation that carries them out.   [CiA 301, CiA 305]

The files, in reading order:

    model           the device under test, a case, its steps, its outcome; frames as text
    script          a case of the vectors, read; the cases themselves are in vectors/cases/canopen/conform-*.json
    probe           which objects a device has; the pause between two LSS requests
    eds_objects     the cases of the objects of a device: by its EDS, and in random order
    restore         the values that a case has changed, written back
    battery         all cases for one device, and how one is run
"""
