# SPDX-License-Identifier: Apache-2.0
"""Weakly compressible smoothed particle hydrodynamics with thin two-sided walls."""
