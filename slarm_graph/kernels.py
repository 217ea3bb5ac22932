# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""How loops over cells and beams are compiled, and when what is compiled is still true.

numba keeps compiled code by the date of the function's own file. What that function calls, and the
numbers it reads, are compiled into it and may live in other files: after those changed it would go
on as before. Here the code is kept by all that is compiled into it.

It names what it compiles by a number that begins at one in every process, and numbers the files it
keeps by a list that several processes write at once. Code kept by two processes then shares a name,
and a kernel is called with the other's table of constants, or a signature's file holds another's
code. Here numbers begin anywhere, and a file is named by what it holds.
"""

from __future__ import annotations

import glob
import hashlib
import os
import secrets
from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from itertools import count
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, TypeVar

import numba
import numpy as np
from numba import njit
from numba.core.bytecode import FunctionIdentity
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.dispatcher import Dispatcher

_Function = TypeVar("_Function", bound=Callable[..., Any])

_DIGITS = 32
"""128 bits: two of a billion digests are alike with a probability of 1e-21."""
_NAME_BITS = 60
"""Of a thousand processes of ten thousand functions each, two share a name once in 1e8."""


def _name_apart() -> None:
    """Give what is compiled from now on names that no other process gives."""
    FunctionIdentity._unique_ids = count(secrets.randbits(_NAME_BITS))


_name_apart()
if hasattr(os, "register_at_fork"):  # a child would go on with its parent's numbers
    os.register_at_fork(after_in_child=_name_apart)


def kernel(function: _Function) -> _Function:
    """Compile a function when it is first called, without the interpreter's lock, and keep it.

    Parameters
    ----------
    function : Callable
        What to compile; it may call other kernels and read numbers of its module.

    Returns
    -------
    Callable
        The compiled function, whose kept code is taken only if all it was made of is unchanged.
    """
    compiled: _Function = _compiled(function, {})
    return compiled


def kernel_with(
    *, inline: bool = False, fastmath: frozenset[str] = frozenset()
) -> Callable[[_Function], _Function]:
    """Compile as `kernel` does, otherwise than usual.

    Parameters
    ----------
    inline : bool
        Whether it is written into its callers before types are known.
    fastmath : frozenset of str
        What LLVM may assume of floating-point numbers; by default nothing.
    """
    options = {"inline": "always" if inline else "never", "fastmath": set(fastmath)}
    return partial(_compiled, options=options)


def _compiled(function: Any, options: Mapping[str, Any]) -> Any:
    dispatcher = njit(nogil=True, **options)(function)
    if isinstance(dispatcher, Dispatcher):  # NUMBA_DISABLE_JIT leaves the function as it is
        kept = _KeptByContent(function)
        dispatcher._cache = kept  # type: ignore[attr-defined]
    return dispatcher


class _FilePerKey(IndexDataCacheFile):
    """A file for everything that is kept, named by its key: processes do not meet in it."""

    def flush(self) -> None:
        """Forget all that is kept of the function."""
        self._remove(self._base())

    def save(self, key: tuple[Any, ...], data: Any) -> None:
        """Keep what was compiled, in place of what a change has outdated."""
        name = self._name(key)
        self._save_data(name, data)  # type: ignore[no-untyped-call]
        self._remove(name.rsplit(".", 2)[0], but=name)

    def load(self, key: tuple[Any, ...]) -> Any:
        """Return what is kept; None where there is nothing, or an empty file."""
        try:
            return self._load_data(self._name(key))  # type: ignore[no-untyped-call]
        except (OSError, EOFError):
            return None

    def _name(self, key: tuple[Any, ...]) -> str:
        """Name a file by the call, the machine and numba, and then by the content."""
        *of_call, content = key
        told = repr((numba.__version__, *map(str, of_call))).encode()
        of_call_digest = hashlib.sha256(told).hexdigest()
        return f"{self._base()}.{of_call_digest[:_DIGITS]}.{content[:_DIGITS]}.nbc"

    def _base(self) -> str:
        return str(self._index_name.removesuffix(".nbi"))

    def _remove(self, base: str, but: str = "") -> None:
        """Remove what is kept under a name, or is left of it from before a change."""
        for kept in Path(self._cache_path).glob(f"{glob.escape(base)}.*.nbc"):
            if kept.name != but:
                kept.unlink(missing_ok=True)


class _KeptByContent(FunctionCache):
    """Keeps the compiled code of a function by what was compiled into it."""

    def __init__(self, function: FunctionType) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]
        made = self._cache_file
        self._cache_file = _FilePerKey(  # type: ignore[no-untyped-call]
            self._cache_path, made._index_name.removesuffix(".nbi"), made._source_stamp
        )

    def _index_key(self, signature: Any, codegen: Any) -> tuple[Any, ...]:
        # a digest of the function's own code is numba's, too, and part of its content here
        told = super()._index_key(signature, codegen)  # type: ignore[no-untyped-call]
        call, machine, (_, enclosed) = told
        return (call, machine, enclosed, content_of(self._py_func))


@cache
def content_of(function: FunctionType) -> str:
    """Return a digest of a function, of the kernels it calls and of the values it reads.

    Parameters
    ----------
    function : FunctionType
        As Python knows it, before it was compiled.

    Returns
    -------
    str
        Hexadecimal digits; the same in every process.
    """
    digest = hashlib.sha256()
    for part in _parts(function.__code__, function.__globals__):
        digest.update(part.encode())
        digest.update(b"\0")
    return digest.hexdigest()


def _parts(code: CodeType, values: Mapping[str, Any]) -> Iterator[str]:
    yield code.co_code.hex()
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _parts(constant, values)
        else:
            yield _told(constant)
    for name in code.co_names:
        yield name
        value = values.get(name)
        yield _told(value)
        if isinstance(value, ModuleType):
            yield from (_told(getattr(value, of, None)) for of in code.co_names)


def _told(value: Any) -> str:
    if isinstance(value, Dispatcher):
        options = (f"{name} {_told(of)}" for name, of in sorted(value.targetoptions.items()))
        return " ".join((content_of(value.py_func), *options))
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {value.tobytes().hex()}"
    if isinstance(value, set | frozenset):
        return repr(sorted(map(_told, value)))
    if isinstance(value, type):
        return f"{value.__qualname__} {getattr(value, '_fields', ())}"
    if isinstance(value, int | float | complex | str | bytes | tuple | None):
        return repr(value)
    definition = getattr(value, "_defn", None)
    if isinstance(definition, FunctionType):
        # An intrinsic builds its code by plain functions of its file: all of that counts.
        file = Path(definition.__code__.co_filename)
        return hashlib.sha256(file.read_bytes()).hexdigest()
    return str(getattr(value, "__qualname__", getattr(value, "__name__", type(value))))
