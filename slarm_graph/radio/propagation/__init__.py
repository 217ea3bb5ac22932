# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""How much a signal loses on its way: models behind one seam, and the geometry of links."""
