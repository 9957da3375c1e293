# SPDX-License-Identifier: Apache-2.0
"""The report of a study: one self-contained HTML file."""

from cwmav_rbdo.report.page import write_report

__all__ = ["write_report"]
