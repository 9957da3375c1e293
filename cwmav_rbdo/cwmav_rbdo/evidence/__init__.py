# SPDX-License-Identifier: Apache-2.0
"""Does acceleration help: true evaluations to the optimum, method beside method, over many seeds."""

from cwmav_rbdo.evidence.collect import METHODS, STUDIES, collect
from cwmav_rbdo.evidence.summary import summarise, table_lines, write_figure

__all__ = ["METHODS", "STUDIES", "collect", "summarise", "table_lines", "write_figure"]
