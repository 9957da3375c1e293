# SPDX-License-Identifier: Apache-2.0
"""Lift of clapping wings from smoothed particle hydrodynamics."""

__version__ = "0.1.0"
