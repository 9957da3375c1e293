# SPDX-License-Identifier: Apache-2.0
"""The simulation as a ROS 2 node."""
