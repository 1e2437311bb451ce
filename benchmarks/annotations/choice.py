"""Which sweeps are judged: a few of every log, evenly spread over it, and who recorded the log."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

JUDGED = Path("judged", "logs")
"""Folder of further recordings, beside that of the others."""
RECORDERS = {
    "comprobo24": "DanPark13",
    "ros_behaviors_fsm": "zcoakley",
    "datmo_more": "datmo",
    "hrp_mpc_lidar": "robots_ii",
}
"""Folder → recorder of its logs, where another folder has some of the same; else each folder is one."""
SEPARATE = ("carmen_ple", "leg_tracker_benchmarks", "real_clients")
"""Folders with logs of many recorders."""


@dataclass(frozen=True, slots=True)
class Chosen:
    """Some sweeps of one topic of a log."""

    log: str
    """Path below the folder of the real logs, or below `JUDGED` beside it."""
    topic: str
    count: int
    """Sweeps that are judged."""

    @property
    def recorder(self) -> str:
        """Who recorded it: trees that are reported on a log have seen none of its recorder's."""
        folder = self.log.split("/")[0]
        return self.log if folder in SEPARATE else RECORDERS.get(folder, folder)

    @property
    def name(self) -> str:
        """Short name, unique among those chosen."""
        folder, log = self.log.split("/")[:2]
        return f"{folder}.{log.removesuffix('.bag').removesuffix('.log.gz')}{self.topic.replace('/', '.')}"

    def path(self, folder: Path) -> Path:
        """The log, whose folder of real logs is told; it may not be there."""
        beside = folder.resolve().parent / JUDGED / self.log
        return beside if beside.exists() else folder / self.log

    def sweeps(self, total: int, judged: Iterable[int] = ()) -> list[int]:
        """Positions of the sweeps in a topic that has so many: those judged, and more as far from all others as can be."""
        found = list(judged) or [int((k + 0.5) * total / self.count) for k in range(self.count)]
        while len(found) < min(self.count, total):
            found.append(max(range(total), key=lambda at: min(abs(at - other) for other in found)))
        return sorted(found)


CHOSEN = (
    Chosen("scan_tools/laser_scan_matcher_demo_ros2branch_20230219.bag", "/scan", 9),
    Chosen("obstacle_detector/scans_demo.bag", "/front_scan", 5),
    Chosen("obstacle_detector/scans_demo.bag", "/rear_scan", 5),
    Chosen("leg_tracker/positive_1_raw.bag", "right_scan", 6),
    Chosen("leg_tracker/positive_2_extracted.bag", "/training_scan", 5),
    Chosen("datmo/overtake_ego.bag", "/scan", 5),
    Chosen("datmo/parallel.bag", "/scan", 7),
    Chosen("my_gazebo_tutorials/20_53_49", "/scan", 5),
    Chosen("my_gazebo_tutorials/20_46_08/rosbag2_2024_11_22-20_46_08_0.db3", "/scan", 5),
    Chosen("hrp_mpc_lidar/mylaserdata2.bag", "/scan", 8),
    Chosen("ros_behaviors_fsm/teleop", "/scan", 10),
    Chosen("ros_behaviors_fsm/wall_follower", "/scan", 8),
    Chosen("sick/rms_1xxx_lms_1xx_movement_off.bag", "/sick_lms_1xx/scan", 4),
    Chosen("leg_tracker/demo_stationary_simple_environment.bag", "/scan", 6),
    Chosen("leg_tracker/negative_2.bag", "/left_scan", 4),
    Chosen("leg_tracker/negative_2.bag", "/rear_scan", 4),
    Chosen("leg_tracker/negative_2.bag", "/right_scan", 4),
    Chosen("leg_tracker/positive_3_raw.bag", "right_scan", 6),
    Chosen("leg_tracker/positive_6_extracted.bag", "/training_scan", 6),
    Chosen("robots_ii/mylaserdata_20151128.bag", "/car_1/scan", 5),
    Chosen("robots_ii/src_mylaserdata_20151128.bag", "/robot_0/base_scan", 5),
    Chosen("ros2_selfdriving/full_bag_nav", "/scan", 5),
    Chosen("ros2_selfdriving/circular_bag_framed_0522", "/scan", 6),
    Chosen("comprobo24/test-bag", "/scan", 10),
    Chosen("comprobo24/drive_square", "/scan", 11),
    Chosen("pr2/mylaserdata.bag", "/base_scan", 5),
    Chosen("turtlebot/topics.bag", "/scan", 4),
    Chosen("zcoakley/fsm", "/scan", 4),
    Chosen("zcoakley/person_follower", "/scan", 4),
    Chosen("datmo_more/intersection.bag", "/scan", 4),
    Chosen("datmo_more/two_robots.bag", "/scan", 4),
    Chosen("DanPark13/finite-state-controller", "/scan", 10),
    Chosen("DanPark13/obstacle-avoider", "/scan", 4),
    Chosen("DanPark13/person_follower", "/scan", 4),
    Chosen("leg_tracker_benchmarks/general_tracking_moving_1.bag", "/scan", 17),
    Chosen("leg_tracker_benchmarks/person_following_outdoor_1.bag", "/scan_base2", 6),
    Chosen("carmen_ple/acapulco-corrected.log.gz", "/front_laser", 4),
    Chosen("carmen_ple/belgioioso-corrected.log.gz", "/front_laser", 11),
    Chosen("carmen_ple/csail-corrected.log.gz", "/front_laser", 13),
    Chosen("carmen_ple/edmonton-corrected.log.gz", "/front_laser", 4),
    Chosen("carmen_ple/freiburg-079-corrected-first1500.log.gz", "/front_laser", 15),
    Chosen("carmen_ple/infinite-corridor-corrected-first1500.log.gz", "/front_laser", 13),
    Chosen("carmen_ple/seattle-corrected.log.gz", "/front_laser", 11),
    Chosen("carmen_ple/fhw-corrected.log.gz", "/front_laser", 14),
    Chosen("carmen_ple/intel-corrected.log.gz", "/front_laser", 16),
    Chosen("carmen_ple/orebro-corrected.log.gz", "/front_laser", 16),
    Chosen("sea_me_coss/room_rosbag/rosbag2_2024_03_16-05_34_31_0.db3", "/scan", 7),
    Chosen("sea_me_coss/rosbag_data/rosbag2_2024_03_16-04_36_26_0.db3", "/lidar_data", 5),
    Chosen("real_clients/irs_a1scan.db3", "/scan", 1),
    Chosen("carmen_ple/aces-corrected.log.gz", "/front_laser", 5),
    Chosen("carmen_ple/freiburg-101-corrected.log.gz", "/front_laser", 5),
    Chosen("anlam915/hallway.bag", "scan", 5),
    Chosen("comprobo22/macfirst_floor_take_2_0.db3", "/scan", 4),
    Chosen("andyangtw/pegatron5F.bag", "/scan", 4),
    Chosen("murillo-teixeira/test2.bag", "/scan", 4),
    Chosen("zaki0929/col2.bag", "/scan", 4),
    Chosen("minhphongvn/lidar.bag", "/scan", 4),
    Chosen("Prasham2181/mylaserdataros.bag", "/scan", 4),
    Chosen("Prasham2181/mylaser.bag", "/scan", 2),
    Chosen("yogeshgajjar/hokuyo.bag", "/scan", 4),
    Chosen("ksoltan/drunk_wall_follow_demo_2018-09-18-20-35-31.bag", "/scan", 4),
    Chosen("SeanCCarter/wall_follower.bag", "/scan", 4),
    Chosen("chulhee23/room.bag", "/scan", 1),
    Chosen("khaidarovs/wall_follower_demo.bag", "/scan", 4),
    Chosen("paulruvolo/finite_state_bag_2017-02-06-00-10-00.bag", "/scan", 4),
    Chosen("ntchirkova/wall_follower_demo.bag", "/scan", 4),
    Chosen("kuannie1/wall_follower_demo.bag", "/scan", 4),
    Chosen("itannermahncke/wall_follower_0.db3", "/scan", 4),
    Chosen("CleanestMink126/avoid_obstacles_2018-09-20-22-20-56.bag", "/scan", 4),
    Chosen("evanwu1119/pwall_follower.bag", "/scan", 4),
    Chosen("spiderkiller13/test.bag", "/zed/scan_merged", 1),
    Chosen("rss2026-1/rosbag2_2026_03_07-23_59_20_0.db3", "/scan", 1),
    Chosen("rss2026-1/rosbag2_2026_03_08-15_15_39_0.db3", "/scan", 1),
    Chosen("carlosmccosta/guardian_3.bag", "/scan", 4),
    Chosen("carlosmccosta/jarvis_2.bag", "/driver_laser_security/laser_scan", 1),
    Chosen("cmu16831/robotdata1.log", "/front_laser", 5),
    Chosen("jengol/rp1.bag", "/scan", 1),
    Chosen("tzxb018/2019-07-31-10-32-43.bag", "/hog/scan0", 1),
    Chosen("tzxb018/48-62-78-triangle.bag", "/hog/scan0", 1),
)
