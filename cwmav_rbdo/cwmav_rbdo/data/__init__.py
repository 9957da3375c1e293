# SPDX-License-Identifier: Apache-2.0
"""Reference data. See SOURCES.md for where each file comes from."""
