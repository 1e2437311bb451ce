"""Run by the Python of ROS 1: writes the messages of a bag to the bags that are named, about equally many to each."""

import sys


def main(log: str, *parts: str) -> None:
    """Write the messages of `log` to `parts`."""
    # Only that Python has it.
    import rosbag

    with rosbag.Bag(log) as bag:
        messages = list(bag.read_messages(raw=True, return_connection_header=True))
    size = -(-len(messages) // len(parts))
    for number, part in enumerate(parts):
        with rosbag.Bag(part, "w", compression=("none", "bz2", "lz4")[number % 3]) as out:
            for topic, message, time, header in messages[number * size : (number + 1) * size]:
                out.write(topic, message, time, raw=True, connection_header=header)


if __name__ == "__main__":
    main(*sys.argv[1:])
