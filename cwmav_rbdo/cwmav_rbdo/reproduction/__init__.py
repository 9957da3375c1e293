# SPDX-License-Identifier: Apache-2.0
"""The paper's tables beside ours, with the decisions that touch each of them."""
