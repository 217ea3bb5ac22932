# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""States of objects as data: whole, sharing what was shared, and unable to run anything."""

from __future__ import annotations

import json
import re
import threading
from array import array
from collections import Counter, OrderedDict, deque
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slarm_graph.config import RunConfig
from slarm_graph.constraint import ConstraintKind
from slarm_graph.errors import BadInput
from slarm_graph.files import states
from slarm_graph.files.states import SavedStates, read_states, write_states
from slarm_graph.geometry import Pose2
from slarm_graph.readings import LaserScan, Reading
from slarm_graph.snapshots import BadState, State, restore_state, state_of


class Colour(Enum):
    RED = "red"


class Holder:
    """Something of everything."""

    def __init__(self, seed: int = 0) -> None:
        self.rng = np.random.default_rng(seed)
        self.prepare = partial(round, ndigits=seed)
        self.content: Any = None


@dataclass(slots=True)
class Part:
    """A part with slots."""

    poses: list[Pose2] = field(default_factory=list)


class Careful:
    """Keeps one thing in another form, and one not at all."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.number = 0

    def kept_state(self) -> dict[str, object]:
        return {"digits": list(str(self.number))}

    def take_state(self, state: dict[str, Any]) -> None:
        self.number = int("".join(state["digits"]))


def again(content: object) -> Any:
    """What a fresh holder has after the content went through a snapshot."""
    before, after = Holder(3), Holder(5)
    before.content = content
    restore_state(state_of(before), after)
    return after.content


def test_values_come_back_as_they_were() -> None:
    reading = Reading(
        2**60 + 1, LaserScan(np.arange(3.0), 0.1, 0.2, 0.3, 9.0), Pose2(1.0, -0.0, 3.0)
    )
    content = {
        "numbers": [True, 0, -1, 2**100, 0.1, -0.0, float("inf"), None, np.float32(0.1)],
        ("a", 1): deque([1, (2, "x")], maxlen=4),
        3: OrderedDict(b={1, 2}, a=frozenset({"q"}), c=Counter("aab")),
        "kinds": [Colour.RED, ConstraintKind.LOOP_CLOSURE, array("d", [0.5]), reading],
        "config": RunConfig(seed=4),
    }
    found = again(content)
    assert repr(found) == repr(content)
    assert type(found["numbers"][-1]) is np.float32
    assert found["config"] == content["config"]


@pytest.mark.parametrize(
    "values",
    [
        np.arange(12.0).reshape(3, 4),
        np.asfortranarray(np.arange(12, dtype=np.int32).reshape(3, 4)),
        np.arange(24.0)[::2],
        np.zeros((0, 3)),
        np.array(7),
        np.array([True, False]),
        np.array(["ab", "c"]),
        np.array([np.nan, -0.0]),
    ],
)
def test_arrays_come_back_bit_by_bit_in_their_order_and_own_their_memory(values: Any) -> None:
    found = again(values)
    assert found.dtype == values.dtype
    assert found.tobytes() == values.tobytes()
    assert found.flags.f_contiguous == values.flags.f_contiguous or values.base is not None
    assert found.flags.writeable
    if values.flags.c_contiguous and values.ndim:
        found.resize((5, *found.shape[1:]), refcheck=False)


def test_what_is_shared_stays_shared_and_circles_close() -> None:
    poses, ranges = [Pose2(1.0, 2.0, 0.5)], np.ones(4)
    part = Part(poses)
    content: list[Any] = [part, poses, part, ranges, [ranges]]
    content.append(content)
    found = again(content)
    assert found[0] is found[2]
    assert found[0].poses is found[1]
    assert found[3] is found[4][0]
    assert found[5] is found


def test_random_numbers_go_on_and_functions_are_the_fresh_objects_own() -> None:
    before, after = Holder(3), Holder(5)
    before.rng.random(7)
    lent = after.rng
    restore_state(state_of(before), after)
    assert after.rng is lent
    assert after.rng.random() == before.rng.random()
    assert after.prepare.keywords == {"ndigits": 5}


def test_a_frozen_value_that_others_hold_too_is_left_alone() -> None:
    before, after, start = Holder(), Holder(), Pose2(1.0, 2.0, 0.0)
    before.content, after.content = Pose2(3.0, 4.0, 0.0), start
    restore_state(state_of(before), after)
    assert after.content == Pose2(3.0, 4.0, 0.0)
    assert start == Pose2(1.0, 2.0, 0.0)


def test_a_class_may_say_what_it_keeps() -> None:
    before, after = Careful(), Careful()
    before.number = 123
    restore_state(state_of(before), after)
    assert after.number == 123
    assert after.lock is not before.lock


@pytest.mark.parametrize(
    "content", [threading.Lock(), np.array([object()]), Path("x"), re.compile("x"), 1 + 2j]
)
def test_what_is_no_data_is_refused_with_its_place(content: object) -> None:
    holder = Holder()
    holder.content = [content]
    with pytest.raises(TypeError, match="cannot write a"):
        state_of(holder)


@pytest.mark.parametrize(
    "node",
    [
        ["object", 9, "subprocess:Popen", {"args": "ls"}],
        ["object", 9, "os:system", {}],
        ["object", 9, "slarm_graph.app.cli:main", {}],
        ["object", 9, "slarm_graph.geometry:math", {}],
        ["object", 9, "slarm_graph.geometry:Pose2", {"x": 1.0, "y": 2.0}],
        ["settings", 9, "slarm_graph.geometry:Pose2", {}],
        ["settings", 9, "slarm_graph.config:RunConfig", {"seed": "x"}],
        ["own", 9],
        ["seen", 77],
        ["array", 9, ["<f8", [1000], False, 0]],
        ["array", 9, ["<f8", [-1], False, 0]],
        ["array", 9, ["|O", [1], False, 0]],
        ["array", 9, ["<f8", [10**30], False, 0]],
        ["reduce", 9],
        [],
        [["list"]],
    ],
)
def test_a_doctored_state_is_refused_and_nothing_is_called(node: object) -> None:
    state = state_of(Holder())
    tree = json.loads(state.tree)
    tree[3]["content"] = node
    with pytest.raises(BadState):
        restore_state(State(json.dumps(tree), state.data), Holder())


def test_a_state_of_something_else_is_refused() -> None:
    with pytest.raises(BadState, match="in the place of"):
        restore_state(state_of(Part()), Holder())
    state = state_of(Holder())
    tree = json.loads(state.tree)
    del tree[3]["content"]
    with pytest.raises(BadState, match="without content"):
        restore_state(State(json.dumps(tree), state.data), Holder())
    with pytest.raises(BadState):
        restore_state(State("[" * 100_000, state.data), Holder())


def saved() -> SavedStates:
    holder = Holder()
    holder.content = np.arange(100.0)
    return SavedStates({"backend": state_of(holder)}, {"readings": 12})


def test_a_file_of_states_comes_back(tmp_path: Path) -> None:
    write_states(tmp_path / "state.npz", saved())
    found, after = read_states(tmp_path / "state.npz"), Holder()
    assert found.facts == {"readings": 12}
    restore_state(found.states["backend"], after)
    assert after.content.tolist() == list(range(100))


def test_any_cut_or_changed_file_is_told_in_one_line(tmp_path: Path) -> None:
    """Every 97th length and every 41st byte: read as it was, or refused; never anything else."""
    path, before = tmp_path / "state.npz", saved()
    write_states(path, before)
    whole = path.read_bytes()
    cut = [whole[:size] for size in range(0, len(whole), 97)]
    changed = [
        whole[:at] + bytes([whole[at] ^ 0x55]) + whole[at + 1 :] for at in range(0, len(whole), 41)
    ]
    refused = 0
    for content in cut + changed:
        path.write_bytes(content)
        try:
            found = read_states(path).states["backend"]
        except BadInput as error:
            assert "start the run anew, without --resume" in str(error)
            refused += 1
            continue
        assert found.tree == before.states["backend"].tree
        assert found.data.tobytes() == before.states["backend"].data.tobytes()
    assert refused > 0.9 * len(cut + changed)


@pytest.mark.parametrize(("name", "value"), [("FORMAT", 999), ("__version__", "9.9")])
def test_another_version_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, value: object
) -> None:
    with monkeypatch.context() as later:
        later.setattr(states, name, value)
        write_states(tmp_path / "state.npz", saved())
    with pytest.raises(BadInput, match=rf"is of slarm-graph .*{value}.*; this is 0.*start the run"):
        read_states(tmp_path / "state.npz")


def test_what_another_version_says_of_itself_is_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To twenty letters each: a file can say anything."""
    with monkeypatch.context() as later:
        later.setattr(states, "FORMAT", "f" * 99)
        later.setattr(states, "__version__", "v" * 99)
        write_states(tmp_path / "state.npz", saved())
    with pytest.raises(BadInput) as told:
        read_states(tmp_path / "state.npz")
    assert f"slarm-graph {'v' * 20}, format {'f' * 20};" in str(told.value)


def test_a_compressed_file_is_refused_before_it_is_expanded(tmp_path: Path) -> None:
    with (tmp_path / "state.npz").open("wb") as file:
        np.savez_compressed(file, header=np.zeros(10**6, np.uint8))
    with pytest.raises(BadInput, match="compressed"):
        read_states(tmp_path / "state.npz")


_UNSAFE = re.compile(
    r"\b(pickle|dill|cloudpickle|joblib|shelve|marshal)\b"
    r"|(?<![\w.])(eval|exec|compile|__import__)\("
    r"|yaml\.(load|load_all|unsafe_load|full_load)\((?!.*(SafeLoader|Loader=_))"
    r"|allow_pickle=True|shell=True|os\.system"
)


def test_nothing_in_the_package_can_run_what_a_file_says() -> None:
    root = Path(__file__).parents[1]
    rooms = ("slarm_graph", "frontends", "backends", "eval")
    found = [
        f"{path.relative_to(root)}:{number}: {line.strip()}"
        for room in rooms
        for path in sorted((root / room).rglob("*.py"))
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
        if _UNSAFE.search(line.partition("#")[0]) and '"""' not in line
    ]
    assert found == []
    assert _UNSAFE.search("np.load(path, allow_pickle=True)")
    assert _UNSAFE.search("state = pickle.loads(data)")
    assert _UNSAFE.search("yaml.load(text)")
    assert replace(Part()).poses == []
