# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings to readings: ROS 1 and 2 bags, CARMEN logs; diagnosing and converting them.

A recording format of another package is a class that implements
`slarm_graph.frontends.recordings.formats.RecordingFormat`, with the attribute `settings` (a
`slarm_graph.config.Stage`) and the constructor `(settings,)`.
"""

BUILT_IN = {
    "carmen": "slarm_graph.frontends.recordings.carmen_format:Carmen",
    "lidar-text": "slarm_graph.frontends.recordings.lidar_text:LidarText",
    "world": "slarm_graph.frontends.recordings.world_format:WorldFile",
    "ros": "slarm_graph.frontends.recordings.ros_format:Ros",
}
"""In the order in which they are tried, after those of other packages; the last takes all."""
