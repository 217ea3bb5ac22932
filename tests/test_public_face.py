# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""`import slarm_graph` is light, and gives what its stub promises."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

import slarm_graph
from slarm_graph.errors import BadInput

ROOT = Path(__file__).resolve().parents[1]
HEAVY = {"gtsam", "numba", "matplotlib", "cv2", "scipy", "rosbags", "dask", "numpy", "pydantic"}


def test_importing_it_imports_nothing_else() -> None:
    code = f"import sys, slarm_graph; print({HEAVY!r} & sys.modules.keys())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


def test_everything_promised_is_there() -> None:
    assert len(slarm_graph.__all__) > 60
    for name, (module, there) in slarm_graph._homes().items():
        assert getattr(slarm_graph, name) is getattr(import_module(module), there)
    assert set(slarm_graph.__all__) <= set(dir(slarm_graph))


def test_the_version_has_one_place() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert slarm_graph.__version__ == project["version"]


def test_what_is_not_there_is_refused() -> None:
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        slarm_graph.nothing  # noqa: B018


@pytest.mark.slow
def test_types_are_known_to_users(tmp_path: Path) -> None:
    """A strict mypy user sees functions with their types."""
    script = tmp_path / "script.py"
    script.write_text(
        "from slarm_graph import Pose2, SlamResult, run_backend\n"
        "slam: SlamResult = run_backend([])\n"
        "wrong: int = Pose2()\n"
    )
    mypy = [sys.executable, "-m", "mypy", "--strict", str(script)]
    done = subprocess.run(mypy, capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.stdout.count("error:") == 1, done.stdout
    assert 'script.py:3: error: Incompatible types in assignment (expression has type "Pose2"' in (
        done.stdout
    )


def test_run_backend_refuses_what_there_is_not() -> None:
    with pytest.raises(BadInput, match="no backend 'nothing'"):
        slarm_graph.run_backend([], "nothing")
