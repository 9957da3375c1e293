# SPDX-License-Identifier: Apache-2.0
"""Problem files that come with the package; the two wing studies are the paper's."""
