# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Radio maps from measured RSS: propagation model + residual Gaussian field bounded by walls."""
