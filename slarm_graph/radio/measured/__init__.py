# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Radio maps from measured signal strength: samples, the field between walls, the fused map."""
