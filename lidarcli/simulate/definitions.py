"""The definition of LaserScan as IDL, which some logs carry in place of .msg text."""

from __future__ import annotations

RULE = "=" * 80

LASERSCAN_IDL = f"""\
{RULE}
IDL: sensor_msgs/msg/LaserScan
module sensor_msgs {{
  module msg {{
    struct LaserScan {{
      std_msgs::msg::Header header;
      float angle_min;
      float angle_max;
      float angle_increment;
      float time_increment;
      float scan_time;
      float range_min;
      float range_max;
      sequence<float> ranges;
      sequence<float> intensities;
    }};
  }};
}};

{RULE}
IDL: std_msgs/msg/Header
module std_msgs {{
  module msg {{
    struct Header {{
      builtin_interfaces::msg::Time stamp;
      string frame_id;
    }};
  }};
}};

{RULE}
IDL: builtin_interfaces/msg/Time
module builtin_interfaces {{
  module msg {{
    struct Time {{
      int32 sec;
      uint32 nanosec;
    }};
  }};
}};
"""
