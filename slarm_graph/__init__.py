# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Simultaneous localization and radio mapping (SLARM) with interchangeable SLAM backends.

The architecture in one line::

    source -> Reading* -> SlamBackend -> SlamResult -> recover -> GeographicMap
           -> radio_map -> RadioMap -> eval
"""

__version__ = "0.1.0"
