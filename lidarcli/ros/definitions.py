"""Message definitions that logs carry along with their messages."""

from __future__ import annotations

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROS1 = get_typestore(Stores.ROS1_NOETIC)
ROS2 = get_typestore(Stores.ROS2_HUMBLE)

SCAN = "sensor_msgs/msg/LaserScan"
ODOMETRY = "nav_msgs/msg/Odometry"
TF = "tf2_msgs/msg/TFMessage"

# The ROS 1 store knows the transforms, but not the message of tf2 that carries them.
ROS1.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))


def ros2_definition(name: str) -> str:
    """The ROS 2 .msg text of a type with everything it contains."""
    return ROS2.generate_msgdef(name, ros_version=2)[0]


def ros1_definition(name: str) -> str:
    """The same as ROS 1 writes it: its Header has a `seq`."""
    return ROS1.generate_msgdef(name, ros_version=1)[0]
