# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Opening of signal-strength readings in a file or a topic of the recording."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from slarm_graph.errors import BadInput
from slarm_graph.frontends.signals.rss_files import (
    looks_like_anchor_log,
    read_anchor_log,
    read_rss_csv,
)
from slarm_graph.radio.measured.rss_log import RssLog


def open_rss(given: str, recording: Sequence[Path] = (), distro: str | None = None) -> RssLog:
    """Open readings of signal strength.

    Parameters
    ----------
    given : str
        A file: CSV with the columns `stamp, ap, rss_dbm`, or a log of Bluetooth anchors. Or
        `TOPIC:FIELD[,NAME_FIELD...]` of the recording, such as `/wifi:rssi,ssid,bssid`.
    recording : sequence of Path
        Recording that has the topic.
    distro : str, optional
        ROS 2 release whose message definitions to use where the recording has none.

    Raises
    ------
    BadInput
        When nothing can be read; the message says what was expected.
    """
    path = Path(given)
    if path.is_file():
        return read_anchor_log(path) if looks_like_anchor_log(path) else read_rss_csv(path)
    if ":" not in given or not given.startswith("/"):
        raise BadInput(
            f"--rss {given}: no such file; a topic is written /TOPIC:FIELD[,NAME_FIELD...]"
        )
    from slarm_graph.frontends.signals.rss_topic import read_rss_topic

    topic, _, fields = given.partition(":")
    value, *names = fields.split(",")
    return read_rss_topic(recording, topic, value, names, distro)


def beside(scans: Path) -> str | None:
    """Return the anchors' log `NAME_ble.txt` beside a log of scans, if there is one."""
    if not scans.name.endswith("_scan.txt"):
        return None
    log = scans.with_name(scans.name.removesuffix("_scan.txt") + "_ble.txt")
    return str(log) if log.is_file() and looks_like_anchor_log(log) else None
