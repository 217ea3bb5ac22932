# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""`python -m slarm_graph` is `slarm`."""

from __future__ import annotations

import sys

from slarm_graph.app.cli import main

if __name__ == "__main__":
    sys.exit(main())
