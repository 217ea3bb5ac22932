# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""YAML of all kinds is read as PyYAML's safe loader reads it, and hostile YAML in one line."""

from __future__ import annotations

import resource
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from slarm_graph.errors import BadInput
from slarm_graph.files import yaml_text
from slarm_graph.files.configs import load_config
from slarm_graph.files.maps import read_map
from slarm_graph.files.worlds import load_world
from slarm_graph.files.yaml_text import MAX_VALUES, parse_yaml

plain = st.one_of(
    st.none(), st.booleans(), st.integers(-(2**40), 2**40), st.floats(allow_nan=False), st.text()
)
trees = st.recursive(
    plain,
    lambda below: st.one_of(
        st.lists(below, max_size=4), st.dictionaries(st.text(), below, max_size=4)
    ),
    max_leaves=20,
)


@settings(max_examples=150, deadline=None)
@given(trees, st.booleans())
def test_the_same_values_as_the_safe_loader(tree: object, flow: bool) -> None:
    text = yaml.safe_dump(tree, default_flow_style=flow, allow_unicode=True)
    assert parse_yaml(text, "t").content == yaml.safe_load(text)


def test_aliases_numbers_and_the_lines_of_keys() -> None:
    document = parse_yaml("a: &x {b: 1e-3, c: 0x10}\nd:\n  e: *x\n  f: '7'\n  g: 2001-99-99\n", "t")
    inner = {"b": "1e-3", "c": 16}
    assert document.content == {"a": inner, "d": {"e": inner, "f": "7", "g": "2001-99-99"}}
    assert document.lines == {"a": 1, "a.b": 1, "a.c": 1, "d": 2, "d.e": 3, "d.f": 4, "d.g": 5}


def bomb(levels: int = 10) -> str:
    """Nine times nine times nine ... values from some hundred bytes."""
    lines = ["l0: &l0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"l{n}: &l{n} [{', '.join([f'*l{n - 1}'] * 9)}]" for n in range(1, levels)]
    return "\n".join(lines) + "\n"


HOSTILE = {
    "bomb": (bomb(), f"more than {MAX_VALUES} values"),
    "recursion": ("a: &a\n  x: *a\n", "the alias *a holds itself"),
    "unknown alias": ("a: *b\n", "cannot be read as YAML"),
    "depth": ("a: " + "[" * 10_000, "nested deeper"),
    "tag": ('a: !!python/object/apply:os.system ["true"]\n', "tags such as"),
    "own tag": ("a: !thing 3\n", "tags such as"),
    "list key": ("? [1, 2]\n: 3\n", "a key is a list or a mapping"),
    "twice": ("a: 1\na: 2\n", "the key 'a' stands here twice"),
    "two documents": ("a: 1\n---\nb: 2\n", "a second document"),
    "long number": ("a: " + "9" * 10_000, "is no number"),
    "many": ("a: [" + "1, " * (MAX_VALUES + 1) + "]", f"more than {MAX_VALUES} values"),
    "large": ("a: " + "x" * 3_000_000, "too large"),
    "control characters": ("a: \x01\n", "cannot be read as YAML"),
}


@pytest.mark.parametrize("read", [load_config, read_map, load_world])
@pytest.mark.parametrize("kind", HOSTILE)
def test_hostile_yaml_is_refused_in_one_line(
    tmp_path: Path, read: Callable[[Path], object], kind: str
) -> None:
    text, words = HOSTILE[kind]
    path = tmp_path / "h.yaml"
    path.write_text(text)
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(BadInput) as refused:
        read(path)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 400
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 200_000


def test_hostile_settings_on_the_command_line() -> None:
    for value in ("!!python/name:os.system", "[" * 5000, "9" * 9999):
        with pytest.raises(BadInput) as refused:
            load_config(overrides=[f"seed={value}"])
        assert len(str(refused.value)) < 200


@pytest.mark.parametrize(
    "override",
    [
        "mapping.resolution_m=1e-300",
        "mapping.resolution_m=.nan",
        "explore.resolution_m=1e9",
        "frontend.matching.sigma_m=1e-30",
        "frontend.max_range_m=.inf",
        "gmapping.maps.delta_m=1e-12",
        "simulation.lidar.beams=1000000000",
        "simulation.lidar.rate_hz=1e-200",
        "seed=99999999999999999999999999",
        "checkpoint.every_s=1e300",
    ],
)
def test_no_kernel_is_given_an_unbounded_number(override: str) -> None:
    with pytest.raises(BadInput, match=override.partition("=")[0]):
        load_config(overrides=[override])


def test_all_problems_are_told_at_once(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text("sed: 1\nmapping:\n  resolution_m: 0\n  max_rnge_m: 3\nseed: x\n")
    with pytest.raises(BadInput) as refused:
        load_config(path)
    for words in (":1: unknown key 'sed'", ":4: unknown key", ":3: mapping.", ":5: seed:"):
        assert words in str(refused.value)


def test_as_many_values_as_allowed_are_read_lists_and_aliases_among_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The mapping, two keys, a list of three and its alias, which counts as what it stands for."""
    text = "a: &list [1, 2, 3]\nb: *list\n"
    monkeypatch.setattr(yaml_text, "MAX_VALUES", 11)
    assert parse_yaml(text, "x.yaml").content == {"a": [1, 2, 3], "b": [1, 2, 3]}
    monkeypatch.setattr(yaml_text, "MAX_VALUES", 10)
    with pytest.raises(BadInput, match="more than 10 values, aliases expanded"):
        parse_yaml(text, "x.yaml")
