# SPDX-License-Identifier: Apache-2.0
"""What must not change a result, and what must change it in proportion."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType

from cwmav_common import interfaces
from cwmav_common.mcap_reader import open_recording
from cwmav_common.mcap_writer import BagWriter
from cwmav_rig.analysis import analyse, analyse_data
from cwmav_rig.blocks import Assembler, Block
from cwmav_rig.cycles import find_cycles
from cwmav_rig.sources.mcap import load
from cwmav_rig.synthesise import synthesise
from cwmav_rig.topic_map import resolve
from support.rig_recordings import SMALL, rewrite, split

QUANTITIES = ("flapping_frequency", "angle_of_attack", "airspeed", "lift", "drag", "power")
FEW = settings(max_examples=6, deadline=None, derandomize=True)


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("rig") / "small.mcap"
    synthesise(path, replace(SMALL, seconds=4.0))
    return path


@pytest.fixture(scope="module")
def samples(bag):
    with open_recording(bag) as recording:
        topic_map = resolve(recording, None)
        return load(recording, topic_map), topic_map


def same(found, expected, rel=1e-9):
    for name in QUANTITIES:
        a, b = getattr(found, name), getattr(expected, name)
        assert a.mean == pytest.approx(b.mean, rel=rel), name
        assert a.std == pytest.approx(b.std, rel=rel), name
        assert a.std_high == pytest.approx(b.std_high, rel=rel), name


@given(cuts=st.lists(st.floats(0.01, 0.99), max_size=4, unique=True))
@FEW
def test_any_split_into_files_gives_the_same_result(bag, tmp_path_factory, cuts):
    folder = split(bag, tmp_path_factory.mktemp("split") / "bag", sorted(cuts))
    same(analyse(folder), analyse(bag), rel=1e-12)


@given(
    chunk=st.integers(200, 200_000),
    compression=st.sampled_from(list(CompressionType)),
    chunking=st.booleans(),
)
@FEW
def test_any_chunking_gives_the_same_result(bag, tmp_path_factory, chunk, compression, chunking):
    target = tmp_path_factory.mktemp("chunk") / "copy.mcap"
    copy = rewrite(bag, target, chunk_size=chunk, compression=compression, use_chunking=chunking)
    same(analyse(copy), analyse(bag), rel=1e-12)


@given(shift=st.integers(-1_000_000_000_000_000, 1_000_000_000_000_000))
@FEW
def test_shifting_all_clocks_changes_nothing(bag, tmp_path_factory, shift):
    copy = tmp_path_factory.mktemp("shift") / "copy.mcap"
    with open_recording(bag) as recording, BagWriter(copy) as writer:
        for name, values in recording.metadata.items():
            writer.add_metadata(name, values)
        for message in recording.messages():
            decoded = interfaces.deserialise(message.data, message.type_name)
            if hasattr(decoded, "header"):
                stamp = decoded.header.stamp.sec * 1_000_000_000 + decoded.header.stamp.nanosec + shift
                decoded.header = interfaces.header(stamp, decoded.header.frame_id)
            writer.write(message.topic, message.type_name, decoded, message.log_time_ns + shift)
    same(analyse(copy), analyse(bag), rel=1e-7)


@given(factor=st.floats(0.01, 5.0))  # a drift of the zero that grew with more is refused
@FEW
def test_scaling_the_force_scales_lift_and_nothing_else(samples, factor):
    data, topic_map = samples
    scaled = replace(
        data,
        force=replace(data.force, values=factor * data.force.values),
        tares=tuple(replace(run, wrench=factor * run.wrench) for run in data.tares),
    )
    found = analyse_data(scaled, topic_map, source="scaled")
    expected = analyse_data(data, topic_map, source="as is")
    for name in ("lift", "drag"):
        assert getattr(found, name).mean == pytest.approx(factor * getattr(expected, name).mean, rel=1e-6)
        assert getattr(found, name).std == pytest.approx(factor * getattr(expected, name).std, rel=1e-5)
    assert found.flapping_frequency.std == pytest.approx(expected.flapping_frequency.std, rel=1e-6)
    assert found.power.mean == pytest.approx(expected.power.mean, rel=1e-9)


@given(factor=st.floats(0.2, 5.0))
@FEW
def test_stretching_time_scales_the_frequency(factor):
    phase = np.cumsum(2 * np.pi * (12.0 + 0.15 * np.sin(np.arange(8000) / 300.0)) * 1e-3)
    values = np.zeros((8000, 3))
    values[:, 2] = np.cos(phase) + 0.4 * np.cos(2 * phase + 1)
    step = 1e-3 * factor
    if not 4.0 < 12.0 / factor < 35.0:
        return
    cycles = find_cycles(Block(0.0, step, ("fx", "fy", "fz"), values))
    expected = find_cycles(Block(0.0, 1e-3, ("fx", "fy", "fz"), values))
    # Mains lines are taken off at fixed frequencies, so the agreement is not exact.
    assert cycles.frequency.mean() == pytest.approx(expected.frequency.mean() / factor, rel=1e-3)


@given(
    lengths=st.lists(st.integers(1, 400), min_size=1, max_size=12),
    dropped=st.sets(st.integers(0, 11), max_size=4),
)
@settings(max_examples=60, deadline=None, derandomize=True)
def test_every_sample_is_accounted_for(lengths, dropped):
    """Samples that came and samples that are missing add up, whatever the blocks."""
    assembler = Assembler(("a", "b"))
    rng = np.random.default_rng(0)
    start, kept, total = 0, [], 0
    for k, n in enumerate(lengths):
        data = rng.standard_normal((1, n, 2))
        if k not in dropped or k == 0:
            assembler.add_blocks(np.array([start / 1e4]), 1e4, np.array([start]), np.array([0]), data)
            kept.append((start, n))
            total = start + n
        start += n
    block = assembler.finish()
    assert block.samples == total
    assert block.bad == total - sum(n for _, n in kept)
    assert len(block.values) == -(-total // 10)
    whole = np.zeros(len(block.values), int)
    for first, n in kept:
        np.add.at(whole, np.arange(first, first + n) // 10, 1)
    assert (block.good == (whole == 10)).all()
