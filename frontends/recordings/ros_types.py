# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Message types that hold where a ROS 2 recording brings no definitions."""

from __future__ import annotations

from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore


def typestore_of(distro: str | None) -> Typestore:
    """Return the standard message types of a ROS 2 release, or of the latest."""
    return get_typestore(Stores.LATEST if distro is None else Stores(f"ros2_{distro}"))
