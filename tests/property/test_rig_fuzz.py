# SPDX-License-Identifier: Apache-2.0
"""Damaged recordings: no crash and no hang, only what can be saved or a clear refusal."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cwmav_common.errors import InputError
from cwmav_rig.analysis import analyse
from cwmav_rig.info import describe
from cwmav_rig.synthesise import synthesise
from support.rig_recordings import SMALL, rewrite

SOME = settings(max_examples=25, deadline=None, derandomize=True)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rig")
    synthesise(folder / "small.mcap", replace(SMALL, seconds=2.0))
    return rewrite(folder / "small.mcap", folder / "chunks.mcap", chunk_size=20_000).read_bytes()


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return tmp_path_factory.mktemp("fuzz") / "damaged.mcap"


def survive(path):
    """Look at a recording in both ways; every refusal names the file."""
    for work in (describe, analyse):
        try:
            work(path)
        except InputError as error:
            assert str(path) in str(error)  # noqa: PT017


@given(share=st.floats(0.0, 1.0))
@SOME
def test_truncated_anywhere(data, place, share):
    place.write_bytes(data[: int(share * len(data))])
    survive(place)


@given(damage=st.lists(st.tuples(st.floats(0.0, 0.9999), st.integers(1, 255)), min_size=1, max_size=20))
@SOME
def test_flipped_bits(data, place, damage):
    content = bytearray(data)
    for share, mask in damage:
        content[int(share * len(content))] ^= mask
    place.write_bytes(content)
    survive(place)


@given(noise=st.binary(max_size=3000), magic=st.booleans())
@SOME
def test_random_bytes(place, noise, magic):
    place.write_bytes((b"\x89MCAP0\r\n" if magic else b"") + noise)
    survive(place)


@given(share=st.floats(0.001, 0.99), noise=st.binary(min_size=1, max_size=500))
@SOME
def test_bytes_inserted_or_overwritten(data, place, share, noise):
    cut = int(share * len(data))
    place.write_bytes(data[:cut] + noise + data[cut:])
    survive(place)
