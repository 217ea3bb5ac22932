# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Texts, arrays and facts of files: what is in them comes back, what is too large is refused."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from slarm_graph.errors import BadInput
from slarm_graph.files import arrays as arrays_module
from slarm_graph.files import inputs
from slarm_graph.files.arrays import load_arrays, read_arrays
from slarm_graph.files.coverage import read_coverage, write_coverage
from slarm_graph.files.inputs import input_facts
from slarm_graph.files.npz import write_npz
from slarm_graph.files.texts import csv_text, read_text
from slarm_graph.geographic import Coverage, GeographicMap
from slarm_graph.grid import GridGeometry


@pytest.mark.parametrize("block_bytes", [1, 7, 1 << 22])
def test_inputs_are_told_by_the_hash_of_all_their_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block_bytes: int
) -> None:
    """Of a folder everything below it, in the order of names; what is missing counts nothing."""
    monkeypatch.setattr(inputs, "_BLOCK_BYTES", block_bytes)
    monkeypatch.chdir(tmp_path)
    for name, content in (("f/b", b"second"), ("f/a/z", b"first"), ("one.bag", b"0123456789")):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(content)
    facts = input_facts([Path("one.bag"), Path("f"), Path("nowhere")])
    assert facts == {
        "paths": [str(tmp_path / name) for name in ("one.bag", "f", "nowhere")],
        "size_bytes": 21,
        "sha256": hashlib.sha256(b"0123456789firstsecond").hexdigest(),
    }


def test_a_text_is_read_up_to_its_most_bytes(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes("\ufeffgr\u00fcn\n".encode())
    size = path.stat().st_size
    assert read_text(path, at_most=size) == "gr\u00fcn\n"
    with pytest.raises(BadInput, match=r"a\.txt: 0\.0 MB are too large for a poem \(at most 0\.0"):
        read_text(path, "a poem", at_most=size - 1)
    path.write_bytes(b"x" * 2_340_000)
    with pytest.raises(BadInput, match=r"2\.3 MB are too large for text \(at most 1\.2\)"):
        read_text(path, at_most=1_200_000)
    path.write_bytes(b"abc\xff")
    with pytest.raises(BadInput, match=r"as text \(byte 0xff at 3 is not of a UTF-8 text\)"):
        read_text(path)
    assert csv_text(("a", "b"), [(1, "x,y"), ("", 2.5)]) == 'a,b\n1,"x,y"\n,2.5\n'


def test_arrays_are_read_up_to_their_most_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.npz"
    own = {"one": np.arange(6.0).reshape(2, 3), "two": np.array("word")}
    write_npz(path, own.items())
    with np.load(path) as theirs:
        assert set(theirs.files) == set(own)
    size = sum(128 + array.nbytes for array in own.values())
    for read in (load_arrays(path, size), read_arrays(path, "numbers")):
        assert all(np.array_equal(read[name], array) for name, array in own.items())
    with pytest.raises(ValueError, match="0 MB are too large"):
        load_arrays(path, size - 1)
    monkeypatch.setattr(arrays_module, "MAX_ARRAY_BYTES", size - 1)
    with pytest.raises(BadInput, match=r"not numbers written by slarm \(0 MB are too large\)"):
        read_arrays(path, "numbers")
    write_npz(path, [("nothing", np.zeros((0, 5))), ("hollow", np.zeros(1001, dtype="V0"))])
    with pytest.raises(ValueError, match="array of nothing claims to be large"):
        load_arrays(path, 1_000)
    assert load_arrays(path, 1_001)["nothing"].shape == (0, 5)


def test_a_geographic_map_comes_back_whole_but_for_its_solids(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    geometry = GridGeometry(-1.25, 7.5, 0.05, 4, 6)
    layers = rng.random((3, *geometry.shape)) < 0.5
    own = GeographicMap(
        geometry,
        rng.integers(0, 5, geometry.shape).astype(np.uint8),
        rng.uniform(0.0, 3.0, geometry.shape).astype(np.float32),
        "known sizes",
        Coverage(*layers),
        17,
        expansion_radius_m=0.35,
    )
    write_coverage(tmp_path / "c.npz", own)
    read = read_coverage(tmp_path / "c.npz")
    assert read.geometry == geometry
    assert (read.height_source, read.changed_cells, read.expansion_radius_m) == (
        "known sizes", 17, 0.35
    )  # fmt: skip
    np.testing.assert_array_equal(read.states, own.states)
    np.testing.assert_array_equal(read.heights_m, own.heights_m)
    for name, layer in zip(("observed", "visited", "footprint"), layers, strict=True):
        np.testing.assert_array_equal(getattr(read.coverage, name), layer)
    with np.load(tmp_path / "c.npz") as file:
        content = dict(file)
    np.savez(tmp_path / "d.npz", **{**content, "visited": layers[0, 1:]})
    with pytest.raises(BadInput, match="layers of different shapes"):
        read_coverage(tmp_path / "d.npz")
