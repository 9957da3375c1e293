# SPDX-License-Identifier: Apache-2.0
"""Between the simulation and ROS: settings of the node, work of its processes, codecs."""
