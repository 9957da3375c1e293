# SPDX-License-Identifier: Apache-2.0
"""Between the optimiser and ROS: settings, evaluation over services, work of the process, codecs."""
