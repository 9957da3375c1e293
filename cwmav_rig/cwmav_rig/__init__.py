# SPDX-License-Identifier: Apache-2.0
"""The rig: recordings of force, power, angle and wind turned into numbers that can be defended."""
