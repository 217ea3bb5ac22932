# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Worlds as YAML files: a boundary, walls, boxes and polygons with heights, access points."""

from __future__ import annotations

import math
from dataclasses import asdict
from importlib import resources
from pathlib import Path

import numpy as np
import yaml
from pydantic import ValidationError

from slarm_graph.access_points import AccessPoint
from slarm_graph.errors import BadInput
from slarm_graph.files.maps import read_map
from slarm_graph.files.world_model import WallModel, WorldModel
from slarm_graph.geometry import Pose2
from slarm_graph.polygons import counter_clockwise, is_simple
from slarm_graph.recovery.wall_shapes import rectangle_m, wall_pieces_m
from slarm_graph.world import Solid, WorldMap
from slarm_graph.world_from_map import world_from_map


def shipped_worlds() -> tuple[str, ...]:
    """Names of the worlds that come with the package."""
    folder = resources.files("slarm_graph") / "worlds"
    return tuple(sorted(f.name[:-5] for f in folder.iterdir() if f.name.endswith(".yaml")))


def load_world(name_or_path: str | Path) -> WorldMap:
    """Read a world from a YAML file, or one that comes with the package by its name.

    A map_server map (`map.yaml` with its image) is a world too: its solids are as high as the
    ceiling, and the robot starts at the widest place.

    Raises
    ------
    BadInput
        Naming the file and the key at fault.
    """
    if str(name_or_path) in shipped_worlds():
        file = resources.files("slarm_graph") / "worlds" / f"{name_or_path}.yaml"
        return world_from_yaml(file.read_text("utf-8"), where=f"{name_or_path}.yaml")
    path = Path(name_or_path)
    try:
        text = path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or "not a text file"
        raise BadInput(
            f"{path}: cannot read the world ({reason}); give a YAML file or one of"
            f" {', '.join(shipped_worlds())}"
        ) from error
    if _is_map(text):
        return world_from_map(read_map(path), name=path.stem)
    return world_from_yaml(text, where=str(path))


def is_world_file(path: Path) -> bool:
    """Whether a file describes a world, or a map that can be driven through like one."""
    if path.suffix not in (".yaml", ".yml") or not path.is_file():
        return False
    try:
        text = path.read_text("utf-8")
    except (OSError, UnicodeDecodeError):
        return False
    return _is_map(text) or "boundary_m" in _keys(text)


def _is_map(text: str) -> bool:
    return {"image", "resolution"} <= _keys(text)


def _keys(text: str) -> set[object]:
    """Top-level keys of a YAML document; none where it is not a mapping."""
    try:
        document = yaml.safe_load(text)
    except yaml.YAMLError:
        return set()
    return set(document) if isinstance(document, dict) else set()


def world_from_yaml(text: str, where: str = "world") -> WorldMap:
    """Parse a world; `where` names the file in error messages."""
    try:
        document = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise BadInput(f"{where}: not YAML: {' '.join(str(error).split())}") from error
    if not isinstance(document, dict):
        raise BadInput(f"{where}: a world is a mapping with name, boundary_m, start, ...")
    try:
        model = WorldModel.model_validate(document)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "world"
        raise BadInput(f"{where}: {key}: {first['msg']}") from error
    return _checked(_build(model), where)


def save_world(world: WorldMap, path: Path) -> None:
    """Write a world as YAML; solids become polygons, which describe the same place."""
    path.write_text(world_to_yaml(world), "utf-8")


def world_to_yaml(world: WorldMap) -> str:
    """Return the YAML text of a world; reading it back gives an equal world."""
    document = {
        "name": world.name,
        "ceiling_m": world.ceiling_m,
        "boundary_m": world.boundary_m.tolist(),
        "start": {
            "x_m": world.start.x,
            "y_m": world.start.y,
            "heading_deg": math.degrees(world.start.theta),
        },
        "access_points": [asdict(ap) for ap in world.access_points],
        "polygons": [
            {"name": s.name, "corners_m": s.corners_m.tolist(), "height_m": s.height_m}
            for s in world.solids
        ],
    }
    return yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)


def _build(model: WorldModel) -> WorldMap:
    solids = [solid for wall in model.walls for solid in _wall_solids(wall)]
    solids += [
        Solid(box.name, rectangle_m(box.center_m, box.size_m, box.heading_deg), box.height_m)
        for box in model.boxes
    ]
    solids += [
        Solid(p.name, counter_clockwise(np.array(p.corners_m)), p.height_m) for p in model.polygons
    ]
    return WorldMap(
        name=model.name,
        solids=tuple(solids),
        boundary_m=counter_clockwise(np.array(model.boundary_m)),
        ceiling_m=model.ceiling_m,
        access_points=tuple(
            AccessPoint(a.name, a.x_m, a.y_m, a.z_m, a.power_dbm, a.frequency_hz)
            for a in model.access_points
        ),
        start=Pose2(model.start.x_m, model.start.y_m, math.radians(model.start.heading_deg)),
    )


def _checked(world: WorldMap, where: str) -> WorldMap:
    """Refuse polygons that cross themselves and access points of equal name."""
    if not is_simple(world.boundary_m):
        raise BadInput(f"{where}: boundary_m: the polygon crosses itself or has no area")
    for solid in world.solids:
        if not is_simple(solid.corners_m):
            raise BadInput(f"{where}: {solid.name}: the polygon crosses itself or has no area")
    names = [ap.name for ap in world.access_points]
    for name in names:
        if names.count(name) > 1:
            raise BadInput(f"{where}: access_points: the name {name!r} is used twice")
    return world


def _wall_solids(wall: WallModel) -> list[Solid]:
    if wall.line_m is not None:
        pieces = wall_pieces_m(np.array(wall.line_m), wall.thickness_m, closed=wall.closed)
    else:
        assert wall.center_m is not None
        assert wall.size_m is not None
        inner = (wall.size_m[0] - wall.thickness_m, wall.size_m[1] - wall.thickness_m)
        line = rectangle_m(wall.center_m, inner, wall.heading_deg)
        pieces = wall_pieces_m(line, wall.thickness_m, closed=True)
    names = [f"{wall.name} {n + 1}" for n in range(len(pieces))] if pieces[1:] else [wall.name]
    return [Solid(name, piece, wall.height_m) for name, piece in zip(names, pieces, strict=True)]
