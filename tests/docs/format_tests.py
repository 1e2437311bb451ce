"""The tests behind docs/formats.md: each row of its tables by its first cell. Paths are below tests/."""

from __future__ import annotations

ROWS = {
    "Containers": {
        "MCAP (`.mcap`)": [
            "test_containers_agree.py::test_the_objects_are_the_same",
            "logs/test_mcap.py::test_every_way_of_writing_reads_the_same",
        ],
        "ROS 1 bag 2.0 (`.bag`, `.active`)": [
            "test_containers_agree.py::test_the_objects_are_the_same",
            "logs/test_rosbag1.py::test_reads_back_every_value",
        ],
        "ROS 2 bag: a folder, with several files if need be": [
            "test_containers_agree.py::test_the_objects_are_the_same",
            "logs/test_rosbag2.py::test_reads_back_every_value",
        ],
        "ROS 2 bag: a bare `.db3`": [
            "test_containers_agree.py::test_the_objects_are_the_same",
            "logs/test_rosbag2.py::test_a_bare_storage_file",
        ],
        "CARMEN log (`.log`, `.clf`, `.gfs`)": [
            "test_containers_agree.py::test_the_objects_are_the_same",
            "logs/test_carmen.py::test_every_kind_of_sweep_is_a_topic_of_its_own",
        ],
        "JSON lines of `mcap cat` and `pymcap-cli cat` (`.jsonl`)": [
            "logs/test_jsonlines.py::test_lines_of_pymcap_cli",
            "test_containers_agree.py::test_the_objects_are_the_same",
            "logs/test_jsonlines.py::test_a_laser_scan",
        ],
        "RPLIDAR text (`.txt`)": [
            "test_containers_agree.py::test_rplidar_text_agrees_but_for_what_it_rounds",
            "logs/test_rplidar.py::test_every_spelling_is_mirrored_and_in_metres",
        ],
        "CSV (`.csv`, `.tsv`, `.txt`, or a folder of them)": [
            "test_containers_agree.py::test_the_objects_are_the_same",
            "logs/test_csv.py::test_layout_reads_back",
        ],
    },
    "Damaged and unusual logs": {
        "no log, an empty file, no such file, no permission, a folder without a log": [
            "cli/test_errors.py::test_a_file_that_is_no_log",
            "cli/test_errors.py::test_no_such_file",
            "cli/test_errors.py::test_no_permission",
            "cli/test_errors.py::test_folder_without_logs",
        ],
        "a folder that may not be entered, below one that is searched": [
            "pipeline/test_inputs.py::test_what_may_not_be_looked_into_is_told"
        ],
        "several logs, one of them bad": ["cli/test_errors.py::test_first_code_that_is_not_zero_and_all_logs_done"],
        "a folder with logs of many kinds, links in a circle, pipes, other files": [
            "logs/test_odd_logs.py::test_a_folder_of_all_kinds",
            "logs/test_odd_logs.py::test_suffixes_in_capitals",
        ],
        "no LaserScan topic, only transforms": [
            "pipeline/test_detecting.py::test_no_scan",
            "logs/test_odd_logs.py::test_a_log_without_a_laser_scan",
        ],
        "the named topic is not there": [
            "cli/test_errors.py::test_wrong_topic",
            "cli/test_errors.py::test_wrong_topic_beside_a_right_one",
            "test_mixed_logs.py::test_a_topic_without_a_leading_slash",
        ],
        "a LaserScan topic without messages; no sweep between `--start` and `--end`": [
            "pipeline/test_detecting.py::test_topic_without_messages_gives_empty_tables",
            "pipeline/test_detecting.py::test_a_window_beyond_the_log_is_told",
        ],
        "several LaserScan topics": [
            "test_mixed_logs.py::test_several_topics_in_one_pass",
            "test_mixed_logs.py::test_more_topics_than_any_robot_has",
        ],
        "several publishers on one topic": [
            "test_mixed_logs.py::test_two_publishers_on_one_topic",
            "test_mixed_logs.py::test_the_first_sweep_is_that_of_each_publisher",
        ],
        "a message that can be no sweep: NaN geometry, zero increment, too many ranges, another definition": [
            "logs/test_mcap.py::test_a_scan_that_is_none_is_counted",
            "logs/test_laserscan.py::test_a_bad_message_is_refused_alone",
            "pipeline/test_detecting.py::test_messages_that_are_refused_count_as_damage",
            "logs/test_multi_echo.py::test_echoes_beyond_the_message_are_refused_intensities_are_not",
            "logs/test_multi_echo.py::test_every_cut_of_a_message_is_refused_or_has_all_ranges",
            "logs/test_doubts.py::test_a_step_of_degrees_is_no_step_of_radians",
            "cli/test_info.py::test_degrees_are_refused",
        ],
        "no beams, 100,000 beams, a changing geometry, odd intensities; a read-only disk; odd names": [
            "test_mixed_logs.py::test_empty_sweeps_are_sweeps",
            "test_mixed_logs.py::test_a_hundred_thousand_beams",
            "test_mixed_logs.py::test_geometry_that_changes_from_sweep_to_sweep",
            "logs/test_odd_logs.py::test_intensities_are_kept_as_far_as_they_go",
            "logs/test_laserscan.py::test_intensities_beyond_the_message_cost_no_sweep",
            "logs/test_intensities.py::test_sweeps_without_intensities_come_back_without",
            "logs/test_intensities.py::test_remissions_that_are_odd_cost_no_sweep",
            "logs/test_intensities.py::test_cells_that_are_no_intensity_cost_no_sweep",
            "cli/test_errors.py::test_odd_names_of_files_neither_break_lines_nor_the_run",
            "cli/test_errors.py::test_names_in_a_log_do_not_steer_the_terminal",
            "test_traced.py::test_reading_changes_nothing",
            "logs/test_mcap_damage.py::test_a_log_that_grows_is_read_as_it_was",
        ],
        "segments of a turn": [
            "logs/test_segments.py::test_segments_become_the_turns_that_they_were",
            "cli/test_join.py::test_turns_of_segments_are_the_sweeps_of_the_full_log",
        ],
        "stamps that are zero, equal, jump back, leap, or are not understood": [
            "test_mixed_logs.py::test_clocks",
            "logs/test_clock.py::test_a_header_without_a_stamp_has_the_time_that_fits",
            "logs/test_clock.py::test_a_stamp_far_from_all_others_is_none",
            "logs/test_doubts.py::test_stamps_that_are_all_equal",
            "logs/test_csv.py::test_times_that_are_not_understood_are_told",
            "logs/test_doubts.py::test_what_is_odd_is_told_in_one_line",
        ],
        "a clock that starts anew": [
            "pipeline/test_runs.py::test_each_run_is_as_if_alone",
            "logs/test_runs.py::test_disorder_is_no_run",
            "pipeline/test_runs.py::test_a_run_that_is_not_there",
        ],
        "a wrong `angle_max`, most ranges beyond 200 m, hardly any range, every message twice": [
            "logs/test_doubts.py::test_angle_max_of_messages",
            "cli/test_info.py::test_every_command_tells_it",
            "logs/test_doubts.py::test_the_unit_of_ranges_is_that_of_any_log",
            "logs/test_doubts.py::test_what_is_odd_is_told_in_one_line",
            "logs/test_doubts.py::test_the_way_out_ends_the_doubt",
        ],
        "an absurd size, a packed bag, a database on a pipe, a silent pipe, a log cut before its first sweep": [
            "logs/test_odd_logs.py::test_a_declared_size_beyond_everything",
            "logs/test_open.py::test_a_packed_log_of_another_kind",
            "logs/test_open.py::test_a_database_on_a_pipe",
            "logs/test_open.py::test_a_named_pipe_without_a_writer_is_given_up",
            "cli/test_errors.py::test_cut_before_the_first_sweep",
        ],
        "point clouds alone, without `--slice`": ["pipeline/test_sliced.py::test_a_log_of_clouds_alone_says_what_to_type"],
        "`--slice` for a log without clouds; with `--range-unit`": [
            "pipeline/test_sliced.py::test_a_slice_of_a_log_without_clouds_says_so",
            "pipeline/test_sliced.py::test_what_has_no_meaning_is_refused",
        ],
        "any order, type and row length of x, y, z; no z, no points, no transform, a pipe": [
            "logs/test_clouds.py::test_every_layout_reads_the_same",
            "logs/test_clouds.py::test_fields_of_different_types_at_odd_places",
            "logs/test_clouds.py::test_an_unorganised_cloud",
            "logs/test_clouds.py::test_a_cloud_without_heights_lies_in_the_plane",
            "logs/test_clouds.py::test_a_cloud_without_points_is_a_sweep_without_returns",
            "pose/test_level.py::test_nothing_is_known",
            "pipeline/test_sliced.py::test_a_pipe_of_clouds",
        ],
        "coordinates that are no floats, fields beyond a point, a message that is cut off": [
            "logs/test_clouds.py::test_what_is_no_cloud_is_refused",
            "logs/test_clouds.py::test_a_cut_message_is_refused_wherever_it_is_cut",
            "logs/test_clouds.py::test_clouds_become_blocks_of_sweeps_and_bad_ones_are_counted",
        ],
        "an MCAP that is cut off": [
            "logs/test_mcap_damage.py::test_every_whole_message_before_a_cut_is_read",
            "logs/test_mcap_damage.py::test_the_whole_blocks_of_a_cut_chunk_are_read",
        ],
        "flipped bits": ["logs/test_mcap_damage.py::test_a_flipped_bit_costs_its_chunk_alone"],
        "no index, a partial one, one that lies; channels described only in the summary": [
            "logs/test_mcap_damage.py::test_a_lying_index_loses_nothing",
            "logs/test_mcap_damage.py::test_a_lying_summary_loses_nothing",
            "logs/test_mcap_damage.py::test_channels_that_are_described_only_in_the_summary",
        ],
        "a chunk that unpacks to more than it may or declares": [
            "logs/test_mcap_damage.py::test_a_hostile_chunk_is_refused_alone",
            "logs/test_odd_logs.py::test_a_bomb_of_an_mcap_chunk_stays_below_what_is_believed",
        ],
        "carriage returns stripped (by git)": ["logs/test_mcap.py::test_what_is_no_log_is_refused"],
        "cut off, or never closed (`.active`); index records of a wrong length": [
            "fuzz/test_truncation.py::test_what_is_recovered_is_the_beginning_of_the_log",
            "logs/test_rosbag1.py::test_unindexed_active_bag",
            "logs/test_rosbag1.py::test_index_records_with_a_wrong_length",
        ],
        "flipped bits in a chunk, in lengths or headers": [
            "logs/test_rosbag1.py::test_a_flipped_chunk_costs_no_other",
            "logs/test_rosbag1.py::test_flips_in_lengths_and_headers_cost_little",
        ],
        "a chunk that unpacks to more than it may": ["logs/test_rosbag1.py::test_a_bomb_is_unpacked_to_its_bound"],
        "format 1.2, an encrypted bag": ["logs/test_rosbag1.py::test_not_a_bag", "logs/test_rosbag1.py::test_encrypted"],
        "`metadata.yaml` missing, broken, a pipe, or naming too few files": [
            "logs/test_rosbag2.py::test_broken_metadata_is_a_note_only",
            "logs/test_rosbag2.py::test_metadata_names_too_few_files",
            "logs/test_rosbag2.py::test_metadata_that_is_no_file_is_not_opened",
        ],
        "a file that is not there or broken, beside others": [
            "logs/test_rosbag2.py::test_metadata_names_files_that_are_not_there",
            "logs/test_rosbag2.py::test_one_broken_file_costs_no_other",
        ],
        "a write-ahead log or journal beside the database": [
            "logs/test_rosbag2.py::test_write_ahead_log",
            "logs/test_hostile_sqlite.py::test_a_journal_brings_back_what_stood_before_the_transaction",
            "logs/test_hostile_sqlite.py::test_no_file_that_a_journal_names_is_touched",
        ],
        "views, triggers, virtual tables, computed columns, pages that lead to themselves": [
            "logs/test_hostile_sqlite.py::test_sql_of_the_file_is_not_run",
            "logs/test_hostile_sqlite.py::test_overflow_pages_that_lead_to_themselves",
        ],
        "a database that is cut off, has broken pages, or broken rows of topics": [
            "logs/test_rosbag2.py::test_truncation_gives_what_is_whole",
            "logs/test_rosbag2.py::test_a_flipped_page_costs_its_own_messages_alone",
            "logs/test_rosbag2.py::test_a_topic_that_is_none_costs_its_own_messages_alone",
        ],
        "bags of old releases, without message definitions": ["logs/test_rosbag2.py::test_old_schemas"],
        "zstd data that is cut off, or unpacks to more than is believable": [
            "logs/test_rosbag2.py::test_cut_packed_file",
            "logs/test_rosbag2.py::test_unpacking_has_a_limit",
        ],
        "a CSV, CARMEN log, JSON lines or RPLIDAR text that is cut off, also amid gzip data": [
            "logs/test_csv_spellings.py::test_who_stops_within_a_turn_loses_nothing",
            "fuzz/test_truncation.py::test_what_is_recovered_is_the_beginning_of_the_log",
            "logs/test_csv.py::test_flipped_bytes_in_gzip_lose_only_what_follows",
            "fuzz/test_truncation.py::test_what_is_recovered_is_the_beginning_of_the_log",
            "logs/test_carmen.py::test_a_last_line_that_is_cut_is_no_sweep",
            "logs/test_jsonlines.py::test_bad_lines_are_named_by_number",
            "logs/test_rplidar.py::test_cut_anywhere_what_is_read_is_the_beginning",
        ],
        "lines that are no data, no messages or no beams": [
            "logs/test_csv.py::test_garbage_in_the_middle_is_counted_by_line",
            "logs/test_carmen.py::test_bad_lines_are_left_out_and_counted",
            "logs/test_jsonlines.py::test_bad_lines_are_named_by_number",
            "logs/test_rplidar.py::test_other_ways_to_write_the_same",
            "logs/test_rplidar.py::test_bad_lines_are_named_and_cost_their_beam_alone",
        ],
        "lines of other messages (`GLOBALPOS`, `IMU`, poses in JSON)": [
            "logs/test_carmen.py::test_bad_lines_are_left_out_and_counted",
            "logs/test_jsonlines.py::test_topics_stay_apart_and_others_are_passed_over",
        ],
        "empty cells, words for missing values": ["logs/test_csv.py::test_missing_cells_and_words"],
        "rows of different lengths": [
            "logs/test_csv.py::test_short_rows_are_sweeps_of_fewer_beams",
            "logs/test_csv.py::test_rows_that_are_not_as_long_as_the_others_are_damage",
        ],
        "arrays that `ros2 topic echo` has abbreviated, no geometry, no column names, several layers": [
            "logs/test_csv.py::test_abbreviated_arrays_are_explained",
            "logs/test_csv.py::test_missing_geometry_names_the_options",
            "logs/test_csv.py::test_a_table_without_names_is_refused_and_read_with_names",
            "logs/test_csv.py::test_columns_that_the_user_names",
            "logs/test_csv_layers.py::test_a_column_of_layers_is_refused",
            "logs/test_csv_layers.py::test_layers_under_one_key_are_no_sweep",
        ],
        "a TUM trajectory, JSON, YAML, XML, a pointer of Git LFS, another table, a `.log` of anything else": [
            "logs/test_csv_others.py::test_it_is_named_with_the_way_out",
            "logs/test_csv.py::test_ros_tables_without_ranges_hold_no_scan",
            "logs/test_csv.py::test_what_is_no_log_says_so_in_one_line",
            "logs/test_carmen.py::test_other_texts_are_no_carmen_logs",
        ],
        "a header without rows": ["logs/test_csv.py::test_header_without_rows_is_a_log_without_sweeps"],
        "thousands of scans in one table, a header of a megabyte, a line without end": [
            "logs/test_csv_headers.py::test_thousands_of_scans_in_one_table",
            "logs/test_csv_headers.py::test_a_header_of_a_megabyte_is_looked_at_quickly",
            "logs/test_csv.py::test_a_line_without_end_stays_within_bounds",
        ],
        "CARMEN without geometry, JSON lines with odd messages, RPLIDAR text without flags": [
            "logs/test_carmen.py::test_old_writers_leave_fields_out",
            "logs/test_wrapping.py::test_wrapping_changes_nothing",
            "logs/test_carmen.py::test_times_may_begin_at_zero_repeat_and_go_back",
            "logs/test_carmen.py::test_equal_times_stay_apart_from_block_to_block",
            "logs/test_carmen.py::test_geometry_is_guessed_by_the_number_of_ranges",
            "logs/test_jsonlines.py::test_a_message_that_can_be_no_sweep_is_counted",
            "logs/test_jsonlines.py::test_times_are_exact_however_they_are_written",
            "logs/test_rplidar.py::test_a_recording_that_begins_and_ends_within_a_turn",
            "logs/test_rplidar.py::test_a_turn_whose_flag_is_lost_is_a_sweep_all_the_same",
            "logs/test_rplidar.py::test_a_flag_may_stand_on_the_last_beam_of_a_sorted_turn",
            "logs/test_rplidar.py::test_uneven_bearings_are_placed_on_a_grid_and_of_two_returns_the_nearer_counts",
            "logs/test_rplidar.py::test_turns_of_different_length_and_beams_left_out",
        ],
    },
    "Outputs": {
        "killed (SIGKILL)": [
            "test_robust_output.py::test_killed_at_any_moment",
            "test_robust_output.py::test_a_killed_overlay_leaves_nothing_that_stays",
        ],
        "interrupted (ctrl-C)": ["test_robust_output.py::test_interrupted_at_any_moment"],
        "terminated (SIGTERM)": ["test_robust_output.py::test_terminated_while_it_writes"],
        "two runs at once into one folder": ["test_newfiles.py::test_without_overwrite_the_first_one_stays"],
        "an output that is an input, or that an option names; a log in the folder of a ROS 2 bag that is read": [
            "test_newfiles.py::test_an_output_that_is_an_input_is_refused",
            "test_newfiles.py::test_every_file_that_an_option_names_is_an_input",
            "test_newfiles.py::test_no_log_becomes_a_part_of_one_that_is_read",
        ],
        "two outputs of one name, or one in the other; `.`, `..` or `/` where a log belongs": [
            "test_newfiles.py::test_two_outputs_of_one_name_or_in_each_other",
            "test_newfiles.py::test_a_folder_by_any_name_is_no_output",
        ],
        "a link where an output belongs": ["test_newfiles.py::test_no_planted_link_is_written_through"],
        "a folder that cannot be written": ["test_newfiles.py::test_a_folder_that_cannot_be_written"],
        "a device, a pipe or a folder of that name": [
            "test_newfiles.py::test_devices_and_folders_are_not_replaced",
            "test_newfiles.py::test_a_bag_replaces_a_folder_that_is_one_bag_or_empty",
            "test_newfiles.py::test_any_other_folder_is_not_replaced",
        ],
        "no room on the disk, or files may not grow": [
            "test_robust_output.py::test_full_disk",
            "test_robust_output.py::test_no_room_for_a_file",
        ],
        "the process that gave work to others (`--jobs`) is killed": [
            "test_robust_output.py::test_workers_end_with_the_process_that_gave_them_work"
        ],
    },
}
