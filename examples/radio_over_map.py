# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Radio map over any map_server (nav2) map.

python examples/radio_over_map.py map.yaml OUT X Y Z
"""

import sys
from pathlib import Path

from slarm_graph import (
    AccessPoint,
    RadioConfig,
    as_geographic,
    radio_map,
    read_map,
    write_radio_npz,
    write_radio_png,
)


def main(map_file: str, out: str, x: str, y: str, z: str) -> None:
    """Read, compute, write."""
    geographic = as_geographic(read_map(Path(map_file)))
    point = AccessPoint("AP1", float(x), float(y), float(z), power_dbm=20.0, frequency_hz=3.5e9)
    radio = radio_map(geographic, [point], RadioConfig(scenario="InF-SH"))
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    write_radio_npz(folder / "radio_map.npz", radio)
    write_radio_png(folder / "radio_map.png", radio)
    low_db, high_db = radio.gain_span_db()
    print(f"expected gain {low_db:.1f} to {high_db:.1f} dB -> {folder}/radio_map.png")


if __name__ == "__main__":
    main(*sys.argv[1:])
