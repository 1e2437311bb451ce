#!/bin/sh
# @foxglove/rosbag: of a bag whose clock was set back while it was recorded, most messages are never yielded.
#
# Packages: @foxglove/rosbag 0.4.1 and tslib 2.9.1 (npm; needs node), rosbags 0.11.9 (PyPI), numpy 2.4.6.
# Guess:    messageIterator({}) yields all messages of a ROS 1 bag, by time, as rosbags does.
# Seen:     1,000 sweeps, the clock goes back by an hour after the 300th. rosbags yields 1,000; messageIterator({}) 300:
#           it starts at the start of the chunk that was WRITTEN first, not at the earliest stamp, and what is older is
#           skipped without a word. Backwards (reverse: true) it starts at the end of the chunk written last and yields
#           the other 700. With a start of zero it yields 1,000.
# So what:  a robot without a clock battery boots with any time and is set right by NTP or GNSS while the recorder runs;
#           a replay of simulated time does the same. A web page or a Node script that reads such a bag shows a part of
#           the drive and nothing tells that there is more. Pass start: {sec: 0, nsec: 0} always, and compare counts
#           with the index.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet numpy==2.4.6 rosbags==0.11.9
cd "$work"
"$work/venv/bin/python" - <<'PYTHON'
import numpy as np
from rosbags.rosbag1 import Reader, Writer
from rosbags.typesys import Stores, get_typestore

types = get_typestore(Stores.ROS1_NOETIC)
Time, Header = types.types["builtin_interfaces/msg/Time"], types.types["std_msgs/msg/Header"]
NAME = "sensor_msgs/msg/LaserScan"
ranges, none = np.full(1081, 2.5, np.float32), np.zeros(0, np.float32)
with Writer("drive.bag") as bag:
    topic = bag.add_connection("/scan", NAME, typestore=types)
    for i in range(1000):
        at = 1_700_000_000_000_000_000 + i * 25_000_000 - (3600 * 10**9 if i >= 300 else 0)
        header = Header(i, Time(*divmod(at, 10**9)), "laser")
        scan = types.types[NAME](header, -2.356, 2.356, 0.004363, 0.0, 0.025, 0.1, 30.0, ranges, none)
        bag.write(topic, at, types.serialize_ros1(scan, NAME))
with Reader("drive.bag") as bag:
    stamps = [stamp for _, stamp, _ in bag.messages()]
print("rosbags:", len(stamps), "messages, sorted:", stamps == sorted(stamps))
assert len(stamps) == 1000 and stamps == sorted(stamps)
PYTHON
npm install --silent --no-fund --no-audit --prefix "$work" @foxglove/rosbag@0.4.1 tslib@2.9.1 >/dev/null
cat >read.cjs <<'NODE'
const assert = require("node:assert");
const { Bag } = require("@foxglove/rosbag");
const { FileReader } = require("@foxglove/rosbag/node");

async function count(options) {
  const file = new FileReader("drive.bag");
  const bag = new Bag(file);
  await bag.open();
  let messages = 0;
  for await (const _ of bag.messageIterator(options)) messages++;
  await file.close();
  console.log("@foxglove/rosbag:", messages, "messages with", JSON.stringify(options));
  return messages;
}

(async () => {
  assert.strictEqual(await count({}), 300);
  assert.strictEqual(await count({ reverse: true }), 700);
  assert.strictEqual(await count({ start: { sec: 0, nsec: 0 } }), 1000);
})().catch((error) => {
  console.error(error);
  process.exit(1);
});
NODE
node read.cjs
