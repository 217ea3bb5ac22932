# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Layers on disk are arrays like any other, and memory only while they are worked on."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from slarm_graph.app.allocation import return_freed
from slarm_graph.app.ending import memory_mb
from slarm_graph.raster import layers
from slarm_graph.raster.layers import new_layer, set_aside

_MB = 1 << 20
_linux_only = pytest.mark.skipif(sys.platform != "linux", reason="layers stay in memory elsewhere")


def _resident_mb() -> float:
    return memory_mb() * 1e6 / _MB


@pytest.mark.parametrize("kind", [np.float32, np.bool_, np.uint8])
@pytest.mark.parametrize("shape", [(3, 5), (2, 6000, 7000)])
def test_a_layer_holds_what_is_written_wherever_it_lies(
    kind: type[np.generic], shape: tuple[int, ...]
) -> None:
    layer = new_layer(shape, kind)
    assert layer.shape == shape
    assert layer.dtype == kind
    assert not layer.any()
    layer[..., ::3, 1] = 1
    set_aside(layer)
    expected = np.zeros(shape, dtype=kind)
    expected[..., ::3, 1] = 1
    np.testing.assert_array_equal(layer, expected)


@_linux_only
def test_a_large_layer_leaves_the_memory_when_it_is_set_aside_or_a_stage_ends() -> None:
    layer = new_layer((8000, 4000), np.float32)
    empty_mb = _resident_mb()
    for whole in (False, True):
        layer += 1.0
        full_mb = _resident_mb()
        assert full_mb > empty_mb + 0.9 * layer.nbytes / _MB
        return_freed() if whole else set_aside(layer[2:4].T)
        assert _resident_mb() < full_mb - 0.9 * layer.nbytes / _MB
    assert (layer == 2.0).all()


@_linux_only
def test_without_room_on_the_disk_a_layer_stays_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(layers.os, "posix_fallocate", full)
    layer = new_layer((8000, 4000), np.float32)
    layer[7000] = 2.0
    set_aside(layer)
    assert layer.base is None
    assert layer.sum() == 8000.0
