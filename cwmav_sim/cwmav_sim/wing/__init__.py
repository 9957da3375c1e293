# SPDX-License-Identifier: Apache-2.0
"""Wing geometry and motion: from a planform to moving sheets the air feels."""
