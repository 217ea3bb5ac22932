# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The tf tree of a recording in full 3D, indexed over all of its time."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slarm_graph.errors import BadInput
from slarm_graph.frontends.recordings.messages import StampedTransforms, join_transforms
from slarm_graph.frontends.recordings.packed import Ints
from slarm_graph.frontends.recordings.rotations import (
    interpolate,
    invert,
    matrices,
    quaternion_of,
    usable_quaternions,
)
from slarm_graph.geometry import Floats

_SAME_M, _SAME_QUATERNION = 1e-6, 1e-7
"""Differences below these are rounding of writers that pass through text or float32."""
_TORN_M, _TORN_SHARE = 0.3, 0.25
"""A stream that jumps so far and returns with the next message, in a quarter of its messages, has
two sources. Halved, a robot that rocks on the spot would count; doubled, two robots that drive
side by side would not."""
TORN = "jumps back and forth between two places: two robots, or two publishers"
_OTHER_M, _OTHER_TURN = 1e-3, 1e-3
"""Static transforms that differ by more [m, quaternion] are two, not one written twice."""


_Rows = tuple[Ints, Floats, Floats]


@dataclass(frozen=True, slots=True)
class Edge:
    """`parent_from_child` over time; a single row holds for all time.

    Parameters
    ----------
    stamp_ns : (N,) int64, strictly increasing
    translations_m : (N, 3)
    quaternions : (N, 4)
        Unit, x y z w.
    """

    stamp_ns: Ints
    translations_m: Floats
    quaternions: Floats

    @property
    def is_static(self) -> bool:
        """Whether the transform never changes."""
        return len(self.stamp_ns) == 1


class TransformTree:
    """All transforms of a recording, looked up at any time.

    Parameters
    ----------
    moving, fixed : iterables of StampedTransforms
        From /tf and /tf_static. A fixed transform holds for all time, whenever it was recorded;
        so does a moving one whose value never changes.
    """

    def __init__(
        self, moving: Iterable[StampedTransforms] = (), fixed: Iterable[StampedTransforms] = ()
    ) -> None:
        self.refused = 0
        self._twofold: dict[tuple[str, str], int] = {}
        self._rows: dict[tuple[str, str], _Rows] = {}
        self._edges: dict[tuple[str, str], Edge] = {}
        self._add(join_transforms(list(moving)), is_fixed=False)
        self._add(join_transforms(list(fixed)), is_fixed=True)

    def _add(self, part: StampedTransforms, *, is_fixed: bool) -> None:
        usable, quaternions = usable_quaternions(part.quaternions)
        usable &= np.isfinite(part.translations_m).all(axis=1)
        self.refused += int(np.count_nonzero(~usable))
        for number, pair in enumerate(part.edges):
            rows = np.flatnonzero((part.edge == number) & usable)
            if rows.size and pair[0] != pair[1]:
                if is_fixed:
                    self._count_values(pair, part.translations_m[rows], quaternions[rows])
                    rows = rows[-1:]
                self._rows[pair] = (
                    part.stamp_ns[rows],
                    part.translations_m[rows],
                    quaternions[rows],
                )

    def _count_values(self, pair: tuple[str, str], places: Floats, turns: Floats) -> None:
        """Count the values with which a static transform was published."""
        rounded = np.round(places / _OTHER_M), np.round(np.abs(turns) / _OTHER_TURN)
        count = len(np.unique(np.concatenate(rounded, axis=1), axis=0))
        if count > 1:
            self._twofold[pair] = count

    def notices(self) -> list[str]:
        """Return notices on static transforms that were published with several values."""
        return [
            f"warning: tf_static {parent} -> {child} has {count} different values, the last is "
            "used; two robots in one recording?"
            for (parent, child), count in self._twofold.items()
        ]

    def pairs(self) -> list[tuple[str, str]]:
        """Return all pairs (parent, child)."""
        return list(self._rows)

    def remove(self, pair: tuple[str, str]) -> None:
        """Remove a transform."""
        del self._rows[pair]

    def edge(self, pair: tuple[str, str]) -> Edge:
        """Return one transform over time; it is sorted at the first call."""
        if pair not in self._edges:
            if torn(self._rows[pair][1]):
                raise BadInput(f"tf {pair[0]} -> {pair[1]} {TORN}; choose with --odom")
            self._edges[pair] = _edge(*self._rows[pair])
        return self._edges[pair]

    def frames(self) -> set[str]:
        """Return all frames."""
        return {frame for pair in self._rows for frame in pair}

    def path(self, target: str, source: str) -> list[tuple[tuple[str, str], bool]] | None:
        """Return the edges from `target` to `source`; True where one is walked forwards."""
        came: dict[str, tuple[str, tuple[str, str], bool]] = {}
        queue, seen = deque([target]), {target}
        while queue and source not in seen:
            frame = queue.popleft()
            for pair in self._rows:
                for here, there, forwards in ((*pair, True), (pair[1], pair[0], False)):
                    if here == frame and there not in seen:
                        seen.add(there)
                        came[there] = (frame, pair, forwards)
                        queue.append(there)
        if source not in seen:
            return None
        steps, frame = [], source
        while frame != target:
            frame, pair, forwards = came[frame]
            steps.append((pair, forwards))
        return steps[::-1]

    def changing(self, target: str, source: str) -> list[Edge]:
        """Return the edges between two frames that change over time."""
        steps = self.path(target, source) or []
        edges = [self.edge(pair) for pair, _ in steps]
        return [edge for edge in edges if not edge.is_static]

    def lookup(
        self, target: str, source: str, at_ns: Ints, max_gap_ns: int
    ) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        """Find `target_from_source` at some stamps.

        Parameters
        ----------
        target, source : str
        at_ns : (N,) int64
        max_gap_ns : int
            Longest gap that is interpolated.

        Returns
        -------
        rotations : (N, 3, 3)
        translations_m : (N, 3)
        known : (N,) bool

        Raises
        ------
        BadInput
            When nothing connects the two frames.
        """
        steps = self.path(target, source)
        if steps is None:
            raise BadInput(self.explain(target, source))
        rotation = np.broadcast_to(np.eye(3), (len(at_ns), 3, 3))
        translation, known = np.zeros((len(at_ns), 3)), np.ones(len(at_ns), bool)
        for pair, forwards in steps:
            edge = self.edge(pair)
            moved, turned, ok = interpolate(
                edge.stamp_ns, edge.translations_m, edge.quaternions, at_ns, max_gap_ns
            )
            step = matrices(turned)
            if not forwards:
                step, moved = invert(step, moved)
            translation = translation + np.einsum("nij,nj->ni", rotation, moved)
            rotation, known = rotation @ step, known & ok
        return np.asarray(rotation), translation, known

    def explain(self, target: str, source: str) -> str:
        """Return why two frames are not connected, and how to connect them."""
        trees = self._trees()
        listed = ", ".join(f"tree {number} = {tree}" for number, tree in enumerate(trees, start=1))
        return (
            f"no path {source} -> {target} in tf: {listed or 'no transforms recorded'}. "
            f"Give --static-tf '{target} {self.ancestors(source)[-1]} x y z yaw' [m, rad]"
        )

    def ancestors(self, frame: str) -> list[str]:
        """Return the frame, its parent, and so on to the root of its tree."""
        chain = [frame]
        while True:
            parents = [parent for parent, child in self._rows if child == chain[-1]]
            if not parents or parents[0] in chain:
                return chain
            chain.append(parents[0])

    def _trees(self) -> list[str]:
        groups: list[list[tuple[str, str]]] = []
        for pair in self._rows:
            touching = [g for g in groups if any(f in other for other in g for f in pair)]
            groups = [g for g in groups if g not in touching]
            groups.append([*(other for g in touching for other in g), pair])
        return [" ".join(f"{parent}>{child}" for parent, child in group) for group in groups]


def torn(places_m: Floats) -> bool:
    """Whether places (N, 3) [m] in recorded order alternate between two paths."""
    if len(places_m) < 8:
        return False
    with np.errstate(invalid="ignore", over="ignore"):
        step = np.linalg.norm(np.diff(places_m, axis=0), axis=1)
        two = np.linalg.norm(places_m[2:] - places_m[:-2], axis=1)
        back_and_forth = (step[:-1] > _TORN_M) & (step[1:] > _TORN_M) & (two < 0.5 * step[:-1])
    return bool(back_and_forth.mean() > _TORN_SHARE)


def _edge(stamps: Ints, translations: Floats, quaternions: Floats) -> Edge:
    """Sort by stamp, keep the first of equal ones, and reduce a constant value to one row."""
    still = np.all(np.abs(translations - translations[0]) <= _SAME_M) and np.all(
        np.abs(quaternions @ quaternions[0]) >= 1.0 - _SAME_QUATERNION**2
    )
    if still:
        return Edge(stamps[:1], translations[:1], quaternions[:1])
    unique, first = np.unique(stamps, return_index=True)
    return Edge(unique, translations[first], quaternions[first])


def parse_static(texts: Iterable[str]) -> StampedTransforms | None:
    """Read `parent child x y z yaw [pitch roll]` [m, rad], as static_transform_publisher takes it.

    Raises
    ------
    BadInput
        When a text has not that form.
    """
    pairs, places, turns = [], [], []
    for text in texts:
        words = text.split()
        try:
            numbers = [float(word) for word in words[2:]]
        except ValueError:
            numbers = []
        if len(numbers) not in (4, 6) or not np.isfinite(numbers).all():
            raise BadInput(
                f"--static-tf {text!r}: expected 'parent child x y z yaw [pitch roll]' [m, rad]"
            )
        pairs.append((words[0].lstrip("/"), words[1].lstrip("/")))
        places.append(numbers[:3])
        turns.append(quaternion_of(*numbers[3:]))
    if not pairs:
        return None
    none = np.zeros(len(pairs), np.int64)
    return StampedTransforms(
        none, none, tuple(pairs), np.arange(len(pairs)), np.array(places), np.array(turns)
    )
