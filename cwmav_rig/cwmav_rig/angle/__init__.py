# SPDX-License-Identifier: Apache-2.0
"""Angle of attack from camera frames: an edge or two marks in, angles with honest standard errors out.

``stream.measure_frames`` turns any iterator of frames (``frames.bag_frames``, ``folder.folder_frames``,
the simulated camera in ``synthetic``) into an ``AngleStream``; ``source.open_source`` says what a path is.
This module imports nothing, so that the topic map knows the settings without OpenCV being loaded.
"""
