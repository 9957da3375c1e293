# SPDX-License-Identifier: Apache-2.0
"""Where samples come from. Every source gives the same blocks and series."""
