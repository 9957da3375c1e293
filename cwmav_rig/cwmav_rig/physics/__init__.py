# SPDX-License-Identifier: Apache-2.0
"""The physical model behind synthetic recordings: air loads, drive, scatter of the controls, force sensor."""
