# SPDX-License-Identifier: Apache-2.0
"""Small synthetic recordings shared by the tests of the rig."""

import pytest

from cwmav_rig.synthesis_settings import Synthesis
from cwmav_rig.synthesise import synthesise
from support.rig_recordings import SMALL


@pytest.fixture(scope="session")
def small_bag(tmp_path_factory):
    """Give a recording of 6 s at 2 kHz: 70 cycles, all roles, clocks that disagree."""
    path = tmp_path_factory.mktemp("rig") / "small.mcap"
    synthesise(path, SMALL)
    return path


@pytest.fixture(scope="session")
def full_bag(tmp_path_factory):
    """Give the paper's point: 30 s at the full rates."""
    path = tmp_path_factory.mktemp("rig") / "full"
    synthesise(path, Synthesis(seed=12))
    return path
