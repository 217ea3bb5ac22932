# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Simultaneous localization and radio mapping (SLARM) with interchangeable SLAM backends.

The architecture in one line::

    source -> Reading* -> SlamBackend -> SlamResult -> recover -> GeographicMap
           -> radio_map -> RadioMap -> eval

What a script needs can be had from here: `from slarm_graph import open_source, run_backend`. What
there is, and where it lives, says the stub beside this file; nothing is imported before it is used.
"""

from __future__ import annotations

import ast
from functools import cache
from importlib import import_module
from pathlib import Path


@cache
def _homes() -> dict[str, tuple[str, str]]:
    """Module and name there of every public name, as the stub has it."""
    stub = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = (node for node in stub.body if isinstance(node, ast.ImportFrom))
    return {
        str(name.asname): (str(node.module), name.name) for node in imports for name in node.names
    }


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version

        value: object = version("slarm-graph")
    elif name == "__all__":
        value = [*_homes(), "__version__"]
    elif name in _homes():
        module, there = _homes()[name]
        value = getattr(import_module(module), there)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_homes(), "__version__"})
