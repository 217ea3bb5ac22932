# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The registry of parts, and what it makes of parts of others, good and bad ones."""

from __future__ import annotations

import sys
import types
from collections.abc import Iterator
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import pytest
from pydantic import Field, ValidationError

from slarm_graph import parts
from slarm_graph.app import cli
from slarm_graph.config import RunConfig, Stage
from slarm_graph.errors import BadInput
from slarm_graph.files.config_text import config_yaml
from slarm_graph.files.configs import load_config


class MineConfig(Stage):
    """A backend of others."""

    gain: float = Field(default=2.0, gt=0)
    """How much."""


class Mine:
    """A part of others."""

    settings = MineConfig

    def __init__(self, *given: object) -> None:
        self.given = given


class WithoutSettings:
    """A part that has nothing to set."""


class Demanding(Stage):
    """Settings that somebody would have to give."""

    gain: float


class WithoutDefaults:
    """A part that cannot be built by default."""

    settings = Demanding


class WrongSettings:
    """A part whose settings are no Stage."""

    settings = 3


def hello(name: str) -> int:
    """Greet somebody."""
    print(f"hello {name}")
    return 3


@pytest.fixture(autouse=True)
def theirs(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Entry points of other packages, as far as this test is concerned."""
    module = types.ModuleType("their_parts")
    for part in (Mine, WithoutSettings, WrongSettings, WithoutDefaults, hello):
        setattr(module, part.__name__, part)
    monkeypatch.setitem(sys.modules, "their_parts", module)
    found = EntryPoints(
        EntryPoint(name, place, group)
        for name, place, group in (
            ("mine", "their_parts:Mine", "slarm_graph.backends"),
            ("odometry", "their_parts:Mine", "slarm_graph.backends"),
            ("missing", "no.such_module:Backend", "slarm_graph.backends"),
            ("no_such_attribute", "their_parts:Other", "slarm_graph.backends"),
            ("plain", "their_parts:WithoutSettings", "slarm_graph.backends"),
            ("wrong", "their_parts:WrongSettings", "slarm_graph.backends"),
            ("demanding", "their_parts:WithoutDefaults", "slarm_graph.backends"),
            ("radio", "their_parts:Mine", "slarm_graph.backends"),
            ("mine", "their_parts:Mine", "slarm_graph.explorers"),
            ("run", "their_parts:hello", "slarm_graph.commands"),
            ("hello", "their_parts:hello", "slarm_graph.commands"),
            ("broken", "no.such_module:hello", "slarm_graph.commands"),
        )
    )
    monkeypatch.setattr(parts, "entry_points", lambda group: found.select(group=group))
    for kept in (parts._added, cli.app):
        kept.cache_clear()
    yield
    for kept in (parts._added, cli.app):
        kept.cache_clear()


@pytest.mark.parametrize("kind", parts.KINDS)
def test_what_is_built_in_can_be_used(kind: str) -> None:
    statuses = {status.place: status for status in parts.statuses(kind)}
    for place in parts._built_in(kind).values():
        assert not statuses[place].problem
        assert statuses[place].summary
        assert "Typer" not in statuses[place].summary


def test_an_unknown_name_is_answered_with_the_known_ones() -> None:
    with pytest.raises(BadInput, match=r"no backend 'gmaping'; there are odometry, gmapping,.*"):
        parts.load("backend", "gmaping")
    with pytest.raises(ValidationError, match=r"did you mean 'gmapping'\?"):
        RunConfig(backend="gmaping")


def test_others_add_parts_but_cannot_replace_ours() -> None:
    assert parts.load("backend", "mine") is Mine
    assert parts.find("backend", "odometry").startswith("slarm_graph.")
    refused = [s for s in parts.statuses("backend") if s.name == "odometry"]
    assert [bool(status.problem) for status in refused] == [False, True]
    assert "built-in" in refused[1].problem


@pytest.mark.parametrize(
    ("kind", "name", "words"),
    [
        ("backend", "missing", "needs the Python module no, which is not installed"),
        ("backend", "no_such_attribute", "no attribute 'Other'"),
        ("backend", "wrong", "no class derived from slarm_graph.config.Stage"),
        ("backend", "demanding", "its settings have no default for gain"),
        ("backend", "radio", "cannot be that of a section"),
        ("explorer", "mine", "there is a backend of the same name"),
    ],
)
def test_what_cannot_be_used_says_why(kind: str, name: str, words: str) -> None:
    status = next(s for s in parts.statuses(kind) if s.name == name)
    assert words in status.problem
    with pytest.raises(BadInput, match=f"{kind} {name} cannot be used: "):
        parts.load(kind, name)


def test_settings_of_a_part_of_others(tmp_path: Path) -> None:
    config = load_config(overrides=["backend=mine", "mine.gain=3"])
    assert config.section("mine") == MineConfig(gain=3.0)
    assert parts.make("backend", "mine", config, "more").given == (MineConfig(gain=3.0), "more")
    path = tmp_path / "config.yaml"
    path.write_text(config_yaml(config))
    assert load_config(path) == config
    assert "mine:\n  gain: 3.0\n" in path.read_text()


def test_settings_of_a_part_that_has_none() -> None:
    assert load_config(overrides=["backend=plain"]).section("plain") == Stage()


def test_all_sections_are_listed_with_those_that_cannot_be_read() -> None:
    text = config_yaml(RunConfig(), comments=True)
    assert "# A backend of others.\nmine:\n  # How much.\n  gain: 2.0  # above 0\n" in text
    assert "# backend missing cannot be used: it needs" in text
    assert "\npose_graph:\n" in text
    assert "\ngmapping:\n" in text


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("mine.gian=3", "unknown key 'mine.gian'; did you mean 'mine.gain'"),
        ("mine.gain=-3", "mine.gain: Input should be greater than 0"),
        ("nobody.gain=3", "unknown key 'nobody.gain'; did you mean 'mine.gain'"),
        ("missing.gain=3", "backend missing cannot be used: it needs"),
    ],
)
def test_wrong_settings_of_parts(override: str, words: str) -> None:
    with pytest.raises(BadInput) as refused:
        load_config(overrides=[override])
    assert words in str(refused.value)


def test_everything_that_is_wrong_is_told_at_once() -> None:
    with pytest.raises(BadInput) as refused:
        load_config(overrides=["seed=a", "mine.gain=0", "maping.x=1", "backend=foo"])
    problems = [str(problem) for problem in refused.value.args]
    assert len(problems) == 4
    for key in ("seed", "mine.gain", "'maping.x'", "backend"):
        assert sum(key in problem.partition(":")[0] + problem[:40] for problem in problems) == 1


def test_commands_of_others(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["hello", "you"]) == 3
    assert capsys.readouterr().out == "hello you\n"
    assert cli.main(["--help"]) == 0
    text = capsys.readouterr().out
    assert "Greet somebody." in text
    assert "command broken cannot be used" in text
    assert cli.main(["broken"]) == cli.BAD_INPUT
    assert "needs the Python module no" in capsys.readouterr().err
    assert cli.main(["run", "no such.bag"]) == cli.BAD_INPUT
