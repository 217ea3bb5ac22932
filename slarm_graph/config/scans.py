# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings of recordings, the scan frontend and the pose graph."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, PrivateAttr

from slarm_graph.config.sections import PartName
from slarm_graph.config.stage import Count, Reach, Resolution, Sigma, Stage

Distro = Literal["dashing", "eloquent", "foxy", "galactic", "humble", "iron", "jazzy", "kilted"]


class SourceConfig(Stage):
    """What to read from a recording."""

    scan_topic: str | None = None
    """Topic of the scans (CARMEN logs: message name); null: chosen automatically."""
    odom: str | None = None
    """Odometry topic, `tf`, `none` for scan matching only; null: chosen automatically."""
    robot_frame: str | None = None
    """Frame of the robot; null: the odometry's child frame, else base_footprint or base_link."""
    odom_frame: str | None = None
    """Parent frame of odometry that is read from tf; null: odom."""
    tf_namespace: str | None = None
    """Namespace of the tf topics to use, such as /robot1; null: that of the scans."""
    static_tf: tuple[str, ...] = ()
    """Additional static transforms, each `parent child x y z yaw [pitch roll]` [m, rad]."""
    segment: int | None = Field(default=None, ge=1)
    """Part to read of a recording whose clock jumps back, counted from 1."""
    max_odom_gap_s: float | None = Field(default=None, gt=0)
    """Longest gap in the odometry that is bridged [s]; null: five times its usual spacing."""
    ros_distro: Distro | None = None
    """ROS 2 release whose message definitions to use for a bag without any (before iron)."""
    stamp_at: Literal["first", "middle", "last"] = "first"
    """Beam at whose time the scan is stamped; `first` by the definition of the ROS message."""
    range_unit_m: float = Field(default=1.0, gt=0, le=1000)
    """Unit of the recorded ranges and range limits; 0.001 for millimetres."""
    angle_unit_rad: float = Field(default=1.0, gt=0, le=10)
    """Unit of the recorded angles; 0.0174533 for degrees."""
    range_min_m: float | None = None
    """Replaces the recorded range_min."""
    range_max_m: float | None = None
    """Replaces the recorded range_max; finite ranges beyond it are invalid."""
    echo: Literal["first", "last", "strongest"] = "first"
    """Return to use of a multi-echo laser's beam."""
    sweep_times: bool = True
    """Whether to trust the recorded time between beams; off with `frontend.deskew=false`."""
    clear_on_inf: bool = True
    """Whether +inf ranges clear the space along the beam (REP-117)."""


class MatchingConfig(Stage):
    """Scan matching against the local map."""

    resolution_m: Resolution = 0.05
    """Cell size of the local map's likelihood grid."""
    sigma_m: Sigma = 0.04
    """Standard deviation by which the likelihood falls off around the map's points."""
    point_sigma_m: Sigma = 0.01
    """Effective standard deviation of a return, its correlations with others allowed for."""
    max_gap_m: float = Field(default=0.5, ge=0)
    """Neighbouring returns nearer than this are joined by a piece of wall."""
    max_iterations: Count = 40
    """Maximum number of Gauss-Newton steps."""
    min_score: float = Field(default=0.35, ge=0, le=1)
    """Minimum mean agreement; a match with less has failed."""
    min_points: int = Field(default=10, ge=3)
    """Minimum number of returns; a scan with fewer is not matched."""


class KeyframeConfig(Stage):
    """Selection of the keyframes that make up the local map."""

    distance_m: float = Field(default=0.25, gt=0)
    """Translation after which a scan becomes a keyframe."""
    angle_rad: float = Field(default=0.25, gt=0)
    """Rotation after which a scan becomes a keyframe, too."""
    window: Count = 40
    """Keyframes of a window; the local map holds one to two windows."""


class FrontendConfig(Stage):
    """The shared scan frontend."""

    matcher: Annotated[str, PartName("matcher")] = "likelihood"
    """Scan matcher that refines a scan's pose: likelihood, icp, correlative, or a plug-in's."""
    max_range_m: Reach = 30.0
    """Longest range of returns used in matching."""
    deskew: bool = True
    """Whether motion distortion of sweeps is corrected, where the recording has beam times."""
    point_spacing_m: float = Field(default=0.02, ge=0)
    """Minimum spacing of returns along the beam order; denser ones are thinned for matching."""
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
    """Search for loop closures while driving."""

    candidates: int = Field(default=1, ge=0)
    """Old submaps matched with a keyframe whose pose is certain (`sure_m`, `sure_rad`)."""
    match_every: int = Field(default=4, ge=1)
    """Keyframes between two such matches."""
    searches: int = Field(default=3, ge=0)
    """Old submaps searched at a time where the predicted pose is uncertain."""
    search_every: int = Field(default=4, ge=1)
    """Keyframes between two such searches."""
    search_again: int = Field(default=40, ge=1)
    """Keyframes until the same old submap is searched again."""
    search_resolution_m: Resolution = 0.1
    """Cell size of the likelihood grids that are searched."""
    search_sigma_m: Sigma = 0.1
    """Standard deviation by which their likelihood falls off."""
    search_score: float = Field(default=0.55, ge=0, le=1)
    """Minimum agreement of a search result that is refined by a match."""
    query_keyframes: int = Field(default=8, ge=1)
    """Latest keyframes whose points are matched together in a search."""
    window_m: float = Field(default=12.0, gt=0, le=1000)
    """Largest half width of the search window, which is as wide as the uncertainty asks for."""
    window_rad: float = Field(default=3.15, gt=0, le=6.3)
    """Largest half width of the search window in heading."""
    sure_m: float = Field(default=0.2, gt=0)
    """Standard deviation up to which the predicted position needs no search."""
    sure_rad: float = Field(default=0.07, gt=0)
    """Standard deviation up to which the predicted heading needs no search."""
    min_score: float = Field(default=0.5, ge=0, le=1)
    """Minimum agreement of a refined match."""
    min_submap_score: float = Field(default=0.35, ge=0, le=1)
    """Minimum agreement of a whole submap, whose free space is compared, too: that of a tracked
    scan. 0.5 hides half of the true returns of edmonton, which hardly any false one joins."""
    max_sigma_m: float = Field(default=0.15, gt=0)
    """Largest standard deviation, in any direction, of a match that closes a loop."""
    confirm_m: float = Field(default=1.0, ge=0)
    """Way to the second match that confirms a searched one; from one place both could err alike."""


class PoseGraphConfig(Stage):
    """The GTSAM pose graph."""

    node_keyframes: int = Field(default=10, ge=2)
    """Maximum keyframes of a submap, a node of the graph that is optimised while driving."""
    node_m: float = Field(default=2.5, gt=0)
    """Longest path of a submap [m]: 10 keyframes of a dense recording."""
    recent_keyframes: int = Field(default=40, ge=1)
    """Submaps with one of this many latest keyframes are no candidates for loop closures."""
    loops: LoopClosureConfig = LoopClosureConfig()
