# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What to read from a recording, and how its scans are matched and closed into loops."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, PrivateAttr

from slarm_graph.config.sections import PartName
from slarm_graph.config.stage import Count, Reach, Resolution, Sigma, Stage

Distro = Literal["dashing", "eloquent", "foxy", "galactic", "humble", "iron", "jazzy", "kilted"]


class SourceConfig(Stage):
    """What to read from a recording."""

    scan_topic: str | None = None
    """Topic with the scans (in CARMEN logs the message name); null to choose by itself."""
    odom: str | None = None
    """Odometry topic, `tf`, `none` for scan matching only, or null to choose by itself."""
    robot_frame: str | None = None
    """Frame of the robot; null: the odometry's child frame, else base_footprint or base_link."""
    odom_frame: str | None = None
    """Frame the odometry is in, where it comes from tf; null: odom."""
    tf_namespace: str | None = None
    """Namespace whose tf is used, such as /robot1; null: that of the scans."""
    static_tf: tuple[str, ...] = ()
    """Extra fixed transforms, each `parent child x y z yaw [pitch roll]` [m, rad]."""
    segment: int | None = Field(default=None, ge=1)
    """Which part to use when the clock jumps back, counted from 1."""
    max_odom_gap_s: float | None = Field(default=None, gt=0)
    """Longest silence of the odometry that is bridged [s]; null: five times its usual spacing."""
    ros_distro: Distro | None = None
    """Release whose message types hold where a ROS 2 bag brings no definitions (before iron)."""
    stamp_at: Literal["first", "middle", "last"] = "first"
    """Which beam the recorded stamps belong to; first, by the definition of the message."""
    range_unit_m: float = Field(default=1.0, gt=0, le=1000)
    """Unit of the recorded ranges and of limits that are in it too; 0.001 for millimetres."""
    angle_unit_rad: float = Field(default=1.0, gt=0, le=10)
    """Unit of the recorded angles; 0.0174533 for degrees."""
    range_min_m: float | None = None
    """Overrides the recorded range_min."""
    range_max_m: float | None = None
    """Overrides the recorded range_max; finite ranges beyond it are invalid."""
    echo: Literal["first", "last", "strongest"] = "first"
    """Which return of a beam to use, where the laser tells several apart."""
    sweep_times: bool = True
    """Whether the recorded time between beams is believed; `frontend.deskew=false` turns it off."""
    clear_on_inf: bool = True
    """Whether +inf ranges clear the space along the beam (REP-117)."""


class MatchingConfig(Stage):
    """Matching every scan against the local map."""

    resolution_m: Resolution = 0.05
    """Side of a cell of the local map's likelihood grid."""
    sigma_m: Sigma = 0.04
    """Standard deviation of the likelihood's fall-off from what was seen."""
    point_sigma_m: Sigma = 0.01
    """What one return is worth against the prediction: its error, correlations allowed for."""
    max_gap_m: float = Field(default=0.5, ge=0)
    """Neighbouring returns nearer than this are joined to a piece of wall."""
    max_iterations: Count = 40
    """Gauss-Newton steps at most."""
    min_score: float = Field(default=0.35, ge=0, le=1)
    """A match with less mean agreement has failed."""
    min_points: int = Field(default=10, ge=3)
    """A scan with fewer returns is not matched."""


class KeyframeConfig(Stage):
    """When a scan becomes part of the local map, and how long it stays."""

    distance_m: float = Field(default=0.25, gt=0)
    """A scan joins the local map after so much translation."""
    angle_rad: float = Field(default=0.25, gt=0)
    """A scan joins the local map after so much rotation, too."""
    window: Count = 40
    """The local map holds one to two windows of keyframes."""


class FrontendConfig(Stage):
    """The shared scan frontend."""

    matcher: Annotated[str, PartName("matcher")] = "likelihood"
    """What refines the place of a scan: likelihood, icp, correlative, or one of another package."""
    max_range_m: Reach = 30.0
    """Returns farther away are not matched."""
    deskew: bool = True
    """Whether the motion during a sweep is undone, where the recording tells its time."""
    point_spacing_m: float = Field(default=0.02, ge=0)
    """Returns denser than this along the beam order are thinned for matching."""
    matching: MatchingConfig = MatchingConfig()
    keyframes: KeyframeConfig = KeyframeConfig()
    _matcher_settings: Stage | None = PrivateAttr(None)

    def with_matcher(self, settings: Stage) -> FrontendConfig:
        """Return the same with the settings of the matcher that is chosen."""
        changed = self.model_copy()
        changed._matcher_settings = settings
        return changed

    def matcher_settings(self) -> Stage | None:
        """Return the settings of the matcher that is chosen; None for its defaults."""
        return self._matcher_settings


class LoopClosureConfig(Stage):
    """Finding old places again."""

    candidates: int = Field(default=1, ge=0)
    """Old submaps compared with a keyframe where the graph is sure of its place."""
    match_every: int = Field(default=4, ge=1)
    """Keyframes between two that are compared so."""
    searches: int = Field(default=3, ge=0)
    """Old submaps searched at a time where it is not."""
    search_every: int = Field(default=4, ge=1)
    """Keyframes between searches."""
    search_again: int = Field(default=40, ge=1)
    """Keyframes until the same old submap is searched again."""
    search_resolution_m: Resolution = 0.1
    """Side of a cell of the grids that are searched."""
    search_sigma_m: Sigma = 0.1
    """Standard deviation of their likelihood's fall-off."""
    search_score: float = Field(default=0.55, ge=0, le=1)
    """Agreement a search must reach to be looked at closer."""
    query_keyframes: int = Field(default=8, ge=1)
    """Latest keyframes whose points are searched for together."""
    window_m: float = Field(default=12.0, gt=0, le=1000)
    """Largest search window to either side; within it the uncertainty decides."""
    window_rad: float = Field(default=3.15, gt=0, le=6.3)
    """Largest search window to either side of the heading."""
    sure_m: float = Field(default=0.2, gt=0)
    """Standard deviation up to which the predicted position needs no search."""
    sure_rad: float = Field(default=0.07, gt=0)
    """Standard deviation up to which the predicted heading needs no search."""
    min_score: float = Field(default=0.5, ge=0, le=1)
    """Agreement a refined match must reach."""
    min_submap_score: float = Field(default=0.35, ge=0, le=1)
    """The same of a whole submap, which its free space must speak for, too: what a tracked scan
    must reach. 0.5 hides half of the true returns of edmonton, which hardly any false one joins."""
    max_sigma_m: float = Field(default=0.15, gt=0)
    """A match less certain than this in any direction closes no loop."""
    confirm_m: float = Field(default=1.0, ge=0)
    """Way to the second match that confirms a searched one; from one place both could err alike."""


class PoseGraphConfig(Stage):
    """The GTSAM pose graph."""

    node_keyframes: int = Field(default=10, ge=2)
    """Keyframes per submap node of the graph that is kept up while driving, at most."""
    node_m: float = Field(default=2.5, gt=0)
    """Way per submap node, at most [m]: 10 keyframes of a dense recording."""
    recent_keyframes: int = Field(default=40, ge=1)
    """Submaps with younger keyframes than this are no old places."""
    loops: LoopClosureConfig = LoopClosureConfig()
