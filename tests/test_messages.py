# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The column decoders against rosbags' own deserializer, on random messages of every encoding."""

from __future__ import annotations

import numpy as np
import pytest
from ros_bags import ENCODINGS, LIMITS, Writer

from slarm_graph.frontends.recordings.messages import (
    decode,
    read_multi_echo,
    read_odometry,
    read_scans,
    read_transforms,
)
from slarm_graph.frontends.recordings.packed import Malformed, pack


def packed(writer: Writer, messages: list[object]):
    return pack((number, writer.raw(message)) for number, message in enumerate(messages))


def stamp_ns(header) -> int:
    return header.stamp.sec * 10**9 + header.stamp.nanosec


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_scans_of_any_frame_and_beam_count_are_read_as_rosbags_reads_them(encoding: str) -> None:
    writer, rng = Writer(encoding), np.random.default_rng(1)
    messages = [writer.scan(rng, int(rng.choice([0, 1, 5, 360]))) for _ in range(60)]
    (blocks,) = decode([packed(writer, messages)], read_scans, cdr=writer.cdr)
    assert sorted(np.concatenate([b.index for b in blocks]).tolist()) == list(range(60))
    for block in blocks:
        for line, number in enumerate(block.index.tolist()):
            message = messages[number]
            assert block.stamp_ns[line] == stamp_ns(message.header)
            assert block.record_ns[line] == number
            assert block.frame == message.header.frame_id.lstrip("/")
            np.testing.assert_array_equal(block.ranges_m[line], message.ranges)
            want = [np.float32(getattr(message, name)) for name in LIMITS]
            np.testing.assert_array_equal(block.limits[line], want)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("echo", ["first", "last", "strongest"])
@pytest.mark.parametrize("lit", [True, False])
def test_one_echo_per_beam(encoding: str, echo: str, lit: bool) -> None:
    writer, rng = Writer(encoding), np.random.default_rng(2)
    messages = [writer.multi_echo(rng, int(rng.choice([0, 4, 30])), lit=lit) for _ in range(20)]

    def one(cursor):
        return read_multi_echo(cursor, echo)

    (blocks,) = decode([packed(writer, messages)], one, cdr=writer.cdr)
    for block in blocks:
        for line, number in enumerate(block.index.tolist()):
            message = messages[number]
            want = []
            for beam, wrapped in enumerate(message.ranges):
                echoes = wrapped.echoes
                if len(echoes) == 0:
                    want.append(np.nan)
                elif echo == "strongest" and lit:
                    want.append(echoes[np.argmax(message.intensities[beam].echoes)])
                else:
                    want.append(echoes[-1 if echo == "last" else 0])
            np.testing.assert_array_equal(block.ranges_m[line], np.array(want, np.float32))


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_odometry_is_read_as_rosbags_reads_it(encoding: str) -> None:
    writer, rng = Writer(encoding), np.random.default_rng(3)
    messages = [writer.odometry(rng) for _ in range(40)]
    (out,) = decode([packed(writer, messages)], read_odometry, cdr=writer.cdr)
    for row, message in enumerate(messages):
        pose = message.pose.pose
        assert out.stamp_ns[row] == stamp_ns(message.header)
        want = (message.header.frame_id.lstrip("/"), message.child_frame_id)
        assert out.edges[out.edge[row]] == want
        p, q = pose.position, pose.orientation
        assert out.translations_m[row].tolist() == [p.x, p.y, p.z]
        assert out.quaternions[row].tolist() == [q.x, q.y, q.z, q.w]


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_transforms_of_one_message_stay_in_order(encoding: str) -> None:
    writer, rng = Writer(encoding), np.random.default_rng(4)
    messages = [writer.tf(rng, int(rng.integers(0, 4))) for _ in range(40)]
    (out,) = decode([packed(writer, messages)], read_transforms, cdr=writer.cdr)
    want = [(number, t) for number, m in enumerate(messages) for t in m.transforms]
    assert len(out) == len(want)
    for row, (number, t) in enumerate(want):
        assert out.stamp_ns[row] == stamp_ns(t.header)
        assert out.record_ns[row] == number
        names = (t.header.frame_id.lstrip("/"), t.child_frame_id.lstrip("/"))
        assert out.edges[out.edge[row]] == names
        v, q = t.transform.translation, t.transform.rotation
        assert out.translations_m[row].tolist() == [v.x, v.y, v.z]
        assert out.quaternions[row].tolist() == [q.x, q.y, q.z, q.w]


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_message_cut_short_is_told_and_nothing_outside_it_is_read(encoding: str) -> None:
    writer, rng = Writer(encoding), np.random.default_rng(5)
    raw = writer.raw(writer.scan(rng, 30))
    echoes = writer.raw(writer.multi_echo(rng, 10, lit=False))
    for cut in (1, 5, 40, len(raw) // 2):
        with pytest.raises(Malformed):
            decode([pack([(0, raw[: -cut - 24]), (1, raw)])], read_scans, cdr=writer.cdr)
    with pytest.raises(Malformed):
        decode([pack([(0, echoes[:-12]), (1, raw)])], read_multi_echo, cdr=writer.cdr)


def test_nothing_recorded_is_nothing_read() -> None:
    assert decode([pack([])], read_scans, cdr=False) == [[]]
    assert decode([pack([])], read_scans, cdr=True) == []
    assert len(decode([pack([])], read_transforms, cdr=False)[0]) == 0
