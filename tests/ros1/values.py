"""For the system's Python: every message of a bag as rosbag and genpy read it, a line of JSON each.

Its topic, type, record time [ns], its bytes as hexadecimal digits, and its values one after the other in the order of
their definition; a time is its seconds and nanoseconds.
"""

import json
import sys


def values(field):
    """The values of a field, one after the other."""
    if hasattr(field, "nsecs"):
        return [field.secs, field.nsecs]
    if hasattr(field, "__slots__"):
        return [value for name in field.__slots__ for value in values(getattr(field, name))]
    if isinstance(field, bytes):
        return list(field)
    if isinstance(field, (list, tuple)):
        return [value for each in field for value in values(each)]
    return [field]


if __name__ == "__main__":
    import rosbag

    with rosbag.Bag(sys.argv[1]) as bag:
        plain = [(topic, raw[0], time.to_nsec(), raw[1].hex()) for topic, raw, time in bag.read_messages(raw=True)]
        told = [values(message) for _, message, _ in bag.read_messages()]
        for message, numbers in zip(plain, told):  # noqa: B905 (the system's Python may be old)
            print(json.dumps([*message, numbers]))
