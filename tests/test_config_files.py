# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Configuration files: round trips, order of precedence, and typos with file, line and a hint."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import pytest
from pydantic.fields import FieldInfo

from slarm_graph import parts
from slarm_graph.config import RadioConfig, RunConfig, Stage
from slarm_graph.errors import BadInput
from slarm_graph.files.config_text import config_yaml
from slarm_graph.files.configs import config_differences, load_config
from slarm_graph.files.yaml_text import parse_yaml
from slarm_graph.radio.path_loss import SCENARIOS


@pytest.mark.parametrize("comments", [True, False])
def test_what_is_printed_is_read_back(tmp_path: Path, comments: bool) -> None:
    config = load_config(overrides=["backend=odometry", "mapping.resolution_m=0.1", "seed=7"])
    path = tmp_path / "config.yaml"
    path.write_text(config_yaml(config, comments=comments))
    assert load_config(path) == config


def test_overrides_beat_the_file_and_the_file_beats_defaults(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text("seed: 3\nbackend: odometry\n")
    config = load_config(path, ["seed=4"])
    assert (config.seed, config.backend) == (4, "odometry")
    assert config.mapping == RunConfig().mapping


def test_every_key_is_explained_or_plain() -> None:
    text = config_yaml(RunConfig(), comments=True)
    assert "# Range at which beams are cut; cells beyond stay unseen.\n  max_range_m: 30.0" in text


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "seed: 1\nmapping:\n  max_rnge_m: 3\n",
            ":3: unknown key 'mapping.max_rnge_m'; did you mean 'mapping.max_range_m'?",
        ),
        ("sed: 1\n", ":1: unknown key 'sed'; did you mean 'seed'?"),
        ("mapping:\n  resolution_m: -1\n", ":2: mapping.resolution_m: Input should be greater"),
        ("- 1\n", ": expected keys and values"),
        ("a: [\n", ": cannot be read as YAML"),
    ],
)
def test_typos_in_a_file(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(text)
    with pytest.raises(BadInput) as refused:
        load_config(path)
    assert str(refused.value).startswith(f"{path}{words}")


def test_a_key_in_the_wrong_section_is_told_where_there_is_one_of_its_name() -> None:
    """For keys of all stages."""
    keys = [key for key in parse_yaml(config_yaml(RunConfig()), "t").lines if "." in key]
    for key in keys[::7]:
        leaf = key.rpartition(".")[2]
        with pytest.raises(BadInput, match="did you mean '") as refused:
            load_config(overrides=[f"quite_another_section_of_a_long_name.{leaf}=1"])
        hint = str(refused.value).partition("did you mean '")[2].partition("'")[0]
        assert hint.rpartition(".")[2] == leaf


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("resolution_m=1", "did you mean 'mapping.resolution_m'"),
        ("seed", "expected key=value"),
        ("seed=a", "seed: Input should be a valid integer"),
        ("seed.x=1", "unknown key 'seed.x'"),
        ("seed=", "seed: Input should be a valid integer, got nothing"),
        ("mapping=3", "mapping: Input should be keys and values, such as mapping.resolution_m"),
        ("pose_graph.loops=3", "keys and values, such as pose_graph.loops."),
        ("mapping.resolution_m={a: 1}", "mapping.resolution_m: Input should be a valid number"),
    ],
)
def test_typos_on_the_command_line(override: str, words: str) -> None:
    with pytest.raises(BadInput) as refused:
        load_config(overrides=[override])
    assert words in str(refused.value)


def test_empty_file_is_all_defaults(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text("# nothing\n")
    assert load_config(path) == RunConfig()


def test_differences_are_named() -> None:
    other = load_config(overrides=["mapping.resolution_m=0.1"])
    assert config_differences(RunConfig(), other) == ("mapping.resolution_m: 0.05 -> 0.1",)


def test_every_setting_says_what_it_means_at_its_key() -> None:
    assert not [key for key, field in settings(RunConfig) if not field.description]
    for name in parts.section_names():
        model = parts.section_settings(name)
        assert model is not None
        assert not [key for key, field in settings(model) if not field.description]


def settings(model: type[Stage], prefix: str = "") -> Iterator[tuple[str, FieldInfo]]:
    for name, field in model.model_fields.items():
        if isinstance(field.annotation, type) and issubclass(field.annotation, Stage):
            yield from settings(field.annotation, f"{prefix}{name}.")
        else:
            yield prefix + name, field


@pytest.mark.parametrize(
    "line",
    [
        "backend: pose_graph  # odometry, gmapping, pose_graph",
        "  occupied_at: 0.25  # above 0, at most 1",
        "    acceleration_m_s2: 1.0  # m/s^2, above 0",
        "  stamp_at: first  # first, middle, last",
        "  segment: null  # at least 1 or null",
        "  straighten: true  # true, false",
    ],
)
def test_units_and_allowed_values_are_listed(line: str) -> None:
    assert line in config_yaml(RunConfig(), comments=True)


def test_scenarios_that_can_be_set_are_those_there_are() -> None:
    assert get_args(RadioConfig.model_fields["scenario"].annotation) == tuple(SCENARIOS)
    with pytest.raises(BadInput, match=r"radio\.scenario: Input should be .InF-SL."):
        load_config(overrides=["radio.scenario=foo"])
