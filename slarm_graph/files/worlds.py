# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Worlds as YAML files: a boundary, walls, boxes and polygons with heights, access points."""

from __future__ import annotations

import math
import re
from dataclasses import asdict
from importlib import resources
from pathlib import Path

import numpy as np
import yaml
from pydantic import ValidationError

from slarm_graph.access_points import AccessPoint
from slarm_graph.errors import BadInput, brief, most
from slarm_graph.files.maps import read_map
from slarm_graph.files.texts import read_text
from slarm_graph.files.world_checks import world_problems
from slarm_graph.files.world_model import WallModel, WorldModel
from slarm_graph.files.world_shapes import rectangle_m, wall_pieces_m
from slarm_graph.files.yaml_text import MAX_BYTES, parse_yaml
from slarm_graph.geometry import Pose2
from slarm_graph.polygons import counter_clockwise
from slarm_graph.world import Solid, WorldMap
from slarm_graph.world_from_map import world_from_map

_WORLD_KEY = re.compile(r"(?m)^boundary_m\s*:")
_MAP_KEYS = re.compile(r"(?m)^image\s*:"), re.compile(r"(?m)^resolution\s*:")


_PLAIN = {
    "missing": "is missing",
    "extra_forbidden": "unknown key; `slarm worlds --template` shows them all",
    "tuple_type": "Input should be a list",
    "model_type": "Input should be keys and values",
}
"""Messages instead of pydantic's, by type of its error."""


def shipped_worlds() -> tuple[str, ...]:
    """Return the names of the shipped worlds."""
    folder = resources.files("slarm_graph") / "worlds"
    return tuple(sorted(f.name[:-5] for f in folder.iterdir() if f.name.endswith(".yaml")))


def world_path(name: str) -> Path:
    """Return the file of a shipped world."""
    return Path(str(resources.files("slarm_graph") / "worlds" / f"{name}.yaml"))


def load_world(name_or_path: str | Path) -> WorldMap:
    """Read a world from a YAML file, or a shipped one by its name.

    A map_server map (`map.yaml` with its image) is a world too: its solids are as high as the
    ceiling, and the robot starts at the widest place.

    Raises
    ------
    BadInput
        Naming the file and the key at fault.
    """
    shipped = str(name_or_path) in shipped_worlds()
    path = world_path(str(name_or_path)) if shipped else Path(name_or_path)
    if not path.is_file():
        raise BadInput(
            f"{brief(str(path))}: cannot read the world (no such file); give a YAML file or one of"
            f" {', '.join(shipped_worlds())}"
        )
    text = read_text(path, "a world", MAX_BYTES)
    if is_map(text, str(path)):
        return world_from_map(read_map(path), name=path.stem)
    return world_from_yaml(text, where=path.name if shipped else str(path))


def is_world_file(path: Path) -> bool:
    """Whether a file describes a world, or a map that can be driven through like one.

    A damaged file is recognised by its words, so that the errors of the world are reported.
    """
    if path.suffix not in (".yaml", ".yml") or not path.is_file():
        return False
    try:
        text = read_text(path, "a world", MAX_BYTES)
    except BadInput:
        return False
    return bool(_WORLD_KEY.search(text)) or (
        bool(_MAP_KEYS[0].search(text)) and bool(_MAP_KEYS[1].search(text))
    )


def is_map(text: str, where: str) -> bool:
    """Whether a YAML text describes a map_server map rather than a world."""
    content = parse_yaml(text, where).content
    return isinstance(content, dict) and {"image", "resolution"} <= set(content)


def world_from_yaml(text: str, where: str = "world") -> WorldMap:
    """Parse a world; `where` names the file in error messages.

    Raises
    ------
    BadInput
        With all errors at once.
    """
    document = parse_yaml(text, where)
    if not isinstance(document.content, dict):
        raise BadInput(f"{where}: a world is a mapping with name, boundary_m, start, ...")
    try:
        model = WorldModel.model_validate(document.content)
    except ValidationError as error:
        problems = [
            f"{where}: {'.'.join(map(str, found['loc'])) or 'world'}: "
            + _PLAIN.get(found["type"], found["msg"].removeprefix("Value error, "))
            for found in error.errors(include_url=False, include_input=False)
        ]
        raise BadInput(*most(problems)) from None
    world = _build(model)
    if amiss := world_problems(world):
        raise BadInput(*most([f"{where}: {problem}" for problem in amiss]))
    return world


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
