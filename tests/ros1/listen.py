"""For the system's Python: subscribe to topics, say so, and print topic and bytes of each message that arrives as JSON."""

import json
import sys
import threading

if __name__ == "__main__":
    import rospy

    rospy.init_node("listener", disable_signals=True, disable_rosout=True)
    one = threading.Lock()

    def tell(message, topic):
        """Print a message."""
        with one:
            print(json.dumps([topic, message._buff.hex()]), flush=True)

    for name in sys.argv[1:]:
        rospy.Subscriber(name, rospy.AnyMsg, tell, callback_args=name)
    print(json.dumps("listening"), flush=True)
    rospy.spin()
