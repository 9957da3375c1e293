# SPDX-License-Identifier: Apache-2.0
"""The optimiser as a ROS 2 node."""
