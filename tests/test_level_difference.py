# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Two maps of levels compared: by hand, by brute force, and by the command."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from slarm_graph.access_points import AccessPoint
from slarm_graph.app.cli import main
from slarm_graph.config import RadioConfig
from slarm_graph.errors import BadInput
from slarm_graph.eval.level_difference import level_difference, save_level_difference
from slarm_graph.files.worlds import load_world
from slarm_graph.grid import GridGeometry
from slarm_graph.radio.files import write_radio_npz
from slarm_graph.radio.levels import LevelMap, read_levels
from slarm_graph.radio.measured.files import write_measured_npz
from slarm_graph.radio.measured.measured_map import FittedTerms, MeasuredMap
from slarm_graph.radio.radio_map import theoretical_radio_map

GRID = GridGeometry(0.0, 0.0, 0.5, 6, 8)


def levels(rng, names, grid=GRID):
    level = rng.normal(-60.0, 5.0, (len(names), *grid.shape)).astype(np.float32)
    level[rng.random(level.shape) < 0.2] = np.nan
    sd = rng.uniform(0.5, 3.0, level.shape).astype(np.float32)
    return LevelMap(grid, names, level, sd, measured=True)


def figures(made):
    return {metric.name: metric.value for metric in made.metrics()}


def test_every_cell_is_compared_with_the_one_it_lies_in():
    """Second implementation: cell by cell, the estimate finer, shifted and of other order."""
    rng = np.random.default_rng(0)
    ref = levels(rng, ("a", "b"))
    est = levels(rng, ("c", "b", "a"), GridGeometry(0.3, -0.2, 0.2, 14, 15))
    found, surely, cells = [], [], set()
    for name in ("a", "b"):
        i, j = ref.names.index(name), est.names.index(name)
        for row, col in np.ndindex(GRID.shape):
            there = est.geometry.cell_of(GRID.center_of([row, col]))
            if not est.geometry.contains(there):
                continue
            off = float(est.level_dbm[j][tuple(there)]) - float(ref.level_dbm[i][row, col])
            if np.isfinite(off):
                sd = np.hypot(est.sd_db[j][tuple(there)], ref.sd_db[i][row, col])
                found.append(off)
                surely.append(abs(off) > 1.96 * sd)
                cells.add((row, col))
    made = figures(level_difference(ref, est))
    assert made["levels_rmse_db"] == pytest.approx(np.sqrt(np.mean(np.square(found))))
    assert made["levels_bias_db"] == pytest.approx(np.mean(found))
    assert made["levels_mae_db"] == pytest.approx(np.mean(np.abs(found)))
    assert made["levels_differ"] == pytest.approx(np.mean(surely))
    assert made["levels_area_m2"] == pytest.approx(0.25 * len(cells))


def test_a_map_does_not_differ_from_itself():
    ref = levels(np.random.default_rng(1), ("a", "b"))
    made = figures(level_difference(ref, ref))
    assert (made["levels_rmse_db"], made["levels_differ"]) == (0.0, 0.0)


def test_cells_of_unknown_certainty_are_neither_alike_nor_different():
    ref = levels(np.random.default_rng(1), ("a",))
    sd_db = ref.sd_db.copy()
    sd_db[:, :, ::2] = np.nan
    other = replace(ref, level_dbm=ref.level_dbm + np.float32(100.0))
    assert figures(level_difference(replace(ref, sd_db=sd_db), other))["levels_differ"] == 1.0
    unknown = replace(ref, sd_db=np.full_like(sd_db, np.nan))
    assert np.isnan(figures(level_difference(unknown, other))["levels_differ"])


def test_maps_with_nothing_in_common_are_refused():
    ref = levels(np.random.default_rng(2), ("a",))
    with pytest.raises(BadInput, match="no access point is in both maps: a and b"):
        level_difference(ref, replace(ref, names=("b",)))
    far = GridGeometry(100.0, 0.0, 0.5, 6, 8)
    with pytest.raises(BadInput, match="one frame"):
        level_difference(ref, replace(ref, geometry=far))


def test_what_is_not_compared_does_not_look_like_no_difference(tmp_path):
    ref = levels(np.random.default_rng(3), ("a",))
    level = np.full_like(ref.level_dbm, -60.0)
    level[:, :, :4] = np.nan
    same = replace(ref, level_dbm=level)
    save_level_difference(tmp_path / "d.png", level_difference(same, same))
    colors = (imread(tmp_path / "d.png")[..., :3] * 255).round().astype(int)
    greys = (colors == 191).all(axis=-1)
    assert greys.mean() > 0.1
    assert not level_difference(same, same).metrics()[-1].note.endswith("s")


def test_every_access_point_has_a_map_of_one_scale(tmp_path, monkeypatch):
    """Whose limits are alike up and down, and exceeded by one value in fifty."""
    drawn = []
    monkeypatch.setattr(Figure, "savefig", lambda self, *_, **__: drawn.append(self))
    rng, names = np.random.default_rng(5), ("a", "b", "c", "d")
    made = level_difference(levels(rng, names), levels(rng, names))
    save_level_difference(tmp_path / "d.png", made)
    *maps, bar = drawn[0].axes
    assert [axes.get_title() for axes in maps] == [*names, "", ""]
    assert [axes.axison for axes in maps] == [True] * 4 + [False] * 2
    assert bar.get_ylabel() == "EST less REF [dB]"
    known = np.abs(made.difference_db[np.isfinite(made.difference_db)])
    for axes, layer in zip(maps, made.difference_db, strict=False):
        (image,) = axes.images
        np.testing.assert_array_equal(image.get_array().filled(np.nan), layer)
        low, high = image.get_clim()
        assert low == -high
        assert np.mean(known > high) == pytest.approx(0.02, abs=0.01)
        assert (tuple(image.get_extent()), image.origin) == (GRID.extent_m, "lower")
        assert image.to_rgba(high)[0] > image.to_rgba(high)[2], "more is red"
    assert [axes.get_xlabel() for axes in maps[:4]] == ["x [m]"] * 4
    assert maps[0].get_ylabel() == "y [m]"
    width_in, height_in = drawn[0].get_size_inches()
    assert (width_in, height_in) == pytest.approx((7.16, 4.2))
    same = level_difference(levels(np.random.default_rng(6), ("a",)),
                            levels(np.random.default_rng(6), ("a",)))  # fmt: skip
    save_level_difference(tmp_path / "d.png", same)
    assert drawn[1].axes[0].images[0].get_clim() == (-0.1, 0.1)


def test_notes_tell_every_access_points_own():
    rng = np.random.default_rng(7)
    ref = levels(rng, ("a", "b"))
    off_db = np.array([3.0, -1.0], dtype=np.float32)[:, None, None]
    made = level_difference(ref, replace(ref, level_dbm=ref.level_dbm + off_db))
    told = {metric.name: metric.note for metric in made.metrics()}
    assert told["levels_rmse_db"] == "a 3.00, b 1.00"
    assert told["levels_bias_db"] == "a +3.00, b -1.00"
    assert told["levels_area_m2"] == "2 access points"


def test_measured_against_predicted_by_command(tmp_path, capsys):
    world = load_world("paper_room")
    geometry = GridGeometry.covering(*world.extent_m(), 0.25)
    radio = theoretical_radio_map(world, geometry, RadioConfig())
    write_radio_npz(tmp_path / "radio_map.npz", radio)
    terms = FittedTerms(9, 0, -40.0, 2.0, 5.0, (1.0, 1.0, 1.0), 3.0, 2.0, 1.0, 5.0, 2.0, 8.0)
    mean = radio.rss_dbm + np.float32(2.0)
    sd = np.full_like(mean, 0.1)
    points = tuple(AccessPoint(ap.name, 0.0, 0.0, 2.0) for ap in radio.access_points)
    made = MeasuredMap(geometry, points, mean, sd, sd, (terms,), 0.5)
    write_measured_npz(tmp_path / "measured_radio_map.npz", made)
    measured, picture = str(tmp_path / "measured_radio_map.npz"), tmp_path / "d.png"
    words = ["eval", "radio", str(tmp_path), measured]
    assert main([*words, "--difference", str(picture), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["levels_bias_db"]["value"] == pytest.approx(2.0, abs=1e-5)
    assert told["levels_differ"]["value"] == 0.0  # a prediction's own doubt is its shadowing
    assert picture.stat().st_size > 10_000
    assert not read_levels(tmp_path).measured
    for name in ("x.nothing", "x"):
        assert main(["eval", "radio", measured, measured, "--difference", name]) == 2
        assert f"--difference {name}: a figure's name ends in .png" in capsys.readouterr().err
    assert main(["eval", "radio", "paper_room", measured]) == 2
    assert "with a radio map, not with a world" in capsys.readouterr().err
    (tmp_path / "bad.npz").write_bytes(b"no")
    assert main(["eval", "radio", measured, str(tmp_path / "bad.npz")]) == 2
