# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The state of objects as data: JSON and bytes of arrays, from which no code can be run.

`state_of` walks an object of this package (or of the package of a plug-in) and everything it
holds: numbers, texts, arrays, containers and objects of the same packages. `restore_state` puts
that back into a fresh object that was built the same way. Functions, threads and the like are not
written; the fresh object keeps its own. What is held twice is held twice again. A class that wants
less or something else written defines `kept_state()`, a dict; and `take_state(dict)` where its
keys are no fields.
"""

from __future__ import annotations

import json
import sys
from array import array
from collections import Counter, OrderedDict, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from functools import partial
from typing import Any, Final, TypeVar

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from slarm_graph.config import Stage

Bytes = NDArray[np.uint8]
Json = Any
"""A leaf is a number, a text, true, false or null; a list is a node whose first entry is its kind:
`["list", id, items]`, `["object", id, "module:Class", {field: value}]` and so on."""
T = TypeVar("T")

_LEAVES: Final = (bool, int, float, str, type(None))
_DTYPES: Final = "biufcSU"
"""Kinds of numpy's types that hold no Python objects."""
_SEQUENCES: Final[dict[type, str]] = {list: "list", set: "set", frozenset: "frozenset"}
_MAPPINGS: Final[dict[type, str]] = {dict: "dict", OrderedDict: "ordered", Counter: "counter"}


@dataclass(frozen=True, slots=True)
class State:
    """What a snapshot holds.

    Parameters
    ----------
    tree : str
        JSON.
    data : (N,) uint8
        The arrays that it refers to, one after the other.
    """

    tree: str
    data: Bytes


class BadState(ValueError):
    """A state that does not fit the object it is put into."""


def state_of(owner: object) -> State:
    """Return the state of an object.

    Raises
    ------
    TypeError
        When it holds something that cannot be written as data, naming where.
    """
    writer = _Writer(_package(type(owner)))
    tree = writer.node(owner, type(owner).__name__)
    data = np.concatenate([np.zeros(0, np.uint8), *writer.parts])
    return State(json.dumps(tree, separators=(",", ":")), data)


def restore_state(state: State, owner: object) -> None:
    """Put a state back into a fresh object of the class, and the settings, it was taken from.

    Raises
    ------
    BadState
        When it is damaged or comes from something else.
    """
    reader = _Reader(_package(type(owner)), state.data)
    try:
        reader.value(json.loads(state.tree), owner)
    except BadState:
        raise
    except (ArithmeticError, AttributeError, LookupError, RecursionError) as error:
        raise BadState(f"{type(error).__name__}: {error}") from None
    except (TypeError, ValueError) as error:
        raise BadState(str(error)) from None


class _Writer:
    """Turns objects into nodes; what was met before becomes a reference."""

    def __init__(self, package: str) -> None:
        self._packages = ("slarm_graph", package)
        self._seen: dict[int, tuple[int, object]] = {}
        self._size = 0
        self.parts: list[Bytes] = []

    def node(self, value: Any, where: str) -> Json:
        """Return the node of a value that is found at a place."""
        if type(value) in _LEAVES:
            return value
        if isinstance(value, (np.generic, tuple, Enum)):
            return self._constant(value, where)
        if id(value) in self._seen:
            return ["seen", self._seen[id(value)][0]]
        number = len(self._seen)
        self._seen[id(value)] = number, value
        return self._container(value, number, where)

    def _constant(self, value: Any, where: str) -> Json:
        if isinstance(value, Enum):
            return ["enum", _name(type(value)), value.name]
        if isinstance(value, np.generic):
            return ["scalar", self._bytes(np.asarray(value))]
        if type(value) is not tuple:
            raise TypeError(f"cannot write a {type(value).__name__} ({where})")
        return ["tuple", [self.node(item, f"{where}[{i}]") for i, item in enumerate(value)]]

    def _container(self, value: Any, number: int, where: str) -> Json:
        if isinstance(value, np.ndarray):
            return ["array", number, self._bytes(value)]
        if type(value) in _SEQUENCES:
            kind = _SEQUENCES[type(value)]
            return [kind, number, [self.node(item, f"{where}[]") for item in value]]
        if type(value) in _MAPPINGS:
            pairs = [[self.node(k, where), self.node(v, f"{where}[{k}]")] for k, v in value.items()]
            return [_MAPPINGS[type(value)], number, pairs]
        if isinstance(value, deque):
            return ["deque", number, value.maxlen, [self.node(item, where) for item in value]]
        if isinstance(value, array):
            return ["typed", number, value.typecode, self._bytes(np.array(value))]
        if isinstance(value, Generator):
            return ["generator", number, value.bit_generator.state]
        if isinstance(value, Stage):
            return ["settings", number, _name(type(value)), value.model_dump(mode="json")]
        return self._object(value, number, where)

    def _object(self, value: Any, number: int, where: str) -> Json:
        if callable(value) or isinstance(value, (partial, type)):
            return ["own", number]
        if _package(type(value)) not in self._packages:
            raise TypeError(f"cannot write a {_name(type(value))} ({where})")
        held = value.kept_state() if hasattr(type(value), "kept_state") else _fields(value)
        nodes = {key: self.node(item, f"{where}.{key}") for key, item in held.items()}
        # `kept_state` may make things that must outlive their number.
        self._seen[id(value)] = number, (value, held)
        return ["object", number, _name(type(value)), nodes]

    def _bytes(self, values: NDArray[Any]) -> Json:
        """Append an array's bytes in the order they lie in memory, which sums may depend on."""
        if values.dtype.kind not in _DTYPES:
            raise TypeError(f"cannot write an array of {values.dtype}")
        transposed = values.ndim > 1 and values.flags.f_contiguous and not values.flags.c_contiguous
        laid = np.ascontiguousarray(values.T if transposed else values)
        self.parts.append(np.frombuffer(laid.tobytes(), np.uint8))
        at, self._size = self._size, self._size + laid.nbytes
        return [values.dtype.str, list(values.shape), transposed, at]


class _Reader:
    """Turns nodes into objects, by way of those that a fresh object already has."""

    def __init__(self, package: str, data: Bytes) -> None:
        self._packages = ("slarm_graph", package)
        self._data = data
        self._made: dict[int, Any] = {}
        self._kinds: dict[str, Callable[..., Any]] = {
            "tuple": lambda _own, items: tuple(self.value(item) for item in items),
            "scalar": lambda _own, where: self._array(where)[()],
            "enum": lambda _own, name, member: self._class(name, Enum)[member],
            "seen": lambda _own, number: self._made[number],
            "own": self._own,
            "array": lambda _own, number, where: self._note(number, self._array(where)),
            "list": lambda _own, number, items: self._fill(self._note(number, []), items),
            "set": partial(self._set, set),
            "frozenset": partial(self._set, frozenset),
            **{kind: partial(self._pairs, cls) for cls, kind in _MAPPINGS.items()},
            "deque": lambda _own, number, most, items: self._fill(
                self._note(number, deque(maxlen=most)), items
            ),
            "typed": lambda _own, number, code, where: self._note(
                number, array(code, self._array(where).tolist())
            ),
            "generator": self._generator,
            "settings": lambda _own, number, name, values: self._note(
                number, self._class(name, Stage).model_validate(values)
            ),
            "object": self._object,
        }

    def value(self, node: Json, own: Any = None) -> Any:
        """Return what a node stands for; `own` is what the fresh object has in its place."""
        return self._kinds[node[0]](own, *node[1:]) if isinstance(node, list) else node

    def _note(self, number: int, made: T) -> T:
        self._made[number] = made
        return made

    def _set(self, cls: type, _own: Any, number: int, items: Sequence[Json]) -> Any:
        return self._note(number, cls(self.value(item) for item in items))

    def _fill(self, into: Any, items: Sequence[Json]) -> Any:
        into.extend(self.value(item) for item in items)
        return into

    def _pairs(self, cls: type, _own: Any, number: int, pairs: Sequence[Json]) -> Any:
        into = self._note(number, cls())
        for key, item in pairs:
            into[self.value(key)] = self.value(item)
        return into

    def _own(self, own: Any, number: int) -> Any:
        if own is None:
            raise BadState("a function has no counterpart in the fresh object")
        return self._note(number, own)

    def _generator(self, own: Any, number: int, state: Mapping[str, Any]) -> Generator:
        """Bring the fresh object's own random numbers to the state, for others may hold it too."""
        generator = own if isinstance(own, Generator) else np.random.default_rng(0)
        generator.bit_generator.state = state
        return self._note(number, generator)

    def _object(self, own: Any, number: int, name: str, nodes: Mapping[str, Json]) -> Any:
        cls = self._class(name, object)
        if own is not None and type(own) is not cls:
            raise BadState(f"a {name} in the place of a {_name(type(own))}")
        # A frozen value may be held by others too, so a new one takes its place.
        params = getattr(cls, "__dataclass_params__", None)
        keep = own is not None and not (params and params.frozen)
        made = self._note(number, own if keep else object.__new__(cls))
        before = {} if own is None else _fields(own)
        if hasattr(cls, "take_state"):
            made.take_state({key: self.value(node, before.get(key)) for key, node in nodes.items()})
            return made
        expected = before.keys() | {f.name for f in fields(cls)} if is_dataclass(cls) else before
        missing = sorted(expected - nodes.keys())
        if missing and not hasattr(cls, "kept_state"):
            raise BadState(f"{name} without {', '.join(missing)}")
        for key, node in nodes.items():
            object.__setattr__(made, key, self.value(node, before.get(key)))
        return made

    def _class(self, name: str, base: type[T]) -> type[Any]:
        """Find a class by name among those that are loaded; nothing is imported for it."""
        module, _, qualified = name.partition(":")
        found = getattr(sys.modules.get(module), qualified, None)
        if (
            module.partition(".")[0] not in self._packages
            or not isinstance(found, type)
            or not issubclass(found, base)
            or found.__module__ != module
        ):
            raise BadState(f"{name} is not known here")
        return found

    def _array(self, where: Json) -> NDArray[Any]:
        """Return an array of its own memory, which may be written to and resized."""
        name, shape, transposed, at = where
        dtype = np.dtype(str(name))
        if dtype.kind not in _DTYPES or at < 0:
            raise BadState(f"an array of {dtype}")
        count = int(np.prod(shape, dtype=object)) if shape else 1
        if count * dtype.itemsize > len(self._data) - at:
            raise BadState("an array ends beyond the data")
        flat = np.frombuffer(self._data, dtype, count, at) if count else np.empty(0, dtype)
        laid = np.empty(shape[::-1] if transposed else shape, dtype)
        laid.reshape(-1)[:] = flat
        return laid.T if transposed else laid


def _fields(owner: object) -> dict[str, Any]:
    """Attributes of an object, those of its slots included."""
    slots = [name for cls in type(owner).__mro__ for name in getattr(cls, "__slots__", ())]
    return {name: getattr(owner, name) for name in slots if hasattr(owner, name)} | dict(
        getattr(owner, "__dict__", {})
    )


def _name(cls: type) -> str:
    return f"{cls.__module__}:{cls.__qualname__}"


def _package(cls: type) -> str:
    return cls.__module__.partition(".")[0]
