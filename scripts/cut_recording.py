#!/usr/bin/env python3
# /// script
# requires-python = ">=3.10"
# dependencies = ["mcap==1.6.0", "cbor2==6.3.0", "msgpack==1.2.4", "protobuf==7.36.2"]
# ///
"""Keep some episodes of a recording, each whole, its messages byte for byte as they were.

Input: a recording of step messages (JSON, CBOR, MessagePack or protobuf) that carry an integer field `episode`. Output:
a recording with the chosen episodes only: same messages, times, schemas, chunk compression and size of chunks. The
lists of the metadata record that have one entry per episode are cut to match.

Example: cut_recording.py cartpole.mcap --episodes 0 1 -o fixtures/recordings/cartpole.mcap
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path

import cbor2
import msgpack
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import McapReader, make_reader
from mcap.records import Channel, Schema
from mcap.writer import CompressionType, Writer

COMPRESSIONS = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4, "": CompressionType.NONE}
PER_EPISODE = ("seed", "policy", "returns")
MAX_CHUNK_SIZE = 1 << 20


def cut(source: Path, target: Path, episodes: list[int]) -> None:
    """Copies `episodes` of `source` into a new recording `target`."""
    with source.open("rb") as stream:
        reader = make_reader(stream)
        header = reader.get_header()
        metadata = list(reader.iter_metadata())
        episode_of = EpisodeOf()
        messages = [(episode_of(s, c, m.data), s, c, m) for s, c, m in reader.iter_messages(log_time_order=False)]
        compression, chunk_size = chunking(reader)
    present = list(dict.fromkeys(episode for episode, *_ in messages))
    if missing := set(episodes) - set(present):
        raise SystemExit(f"{source}: no episode {sorted(missing)}; it has {present}")

    with target.open("wb") as stream:
        writer = Writer(stream, chunk_size=chunk_size, compression=compression)
        writer.start(profile=header.profile, library="cut_recording.py")
        for record in metadata:
            writer.add_metadata(record.name, cut_metadata(record.metadata, present, episodes))
        channels: dict[int, int] = {}
        for episode, schema, channel, message in messages:
            if episode not in episodes:
                continue
            if channel.id not in channels:
                channels[channel.id] = copy_channel(writer, schema, channel)
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time, message.sequence
            )
        writer.finish()


class EpisodeOf:
    """The episode that a step message says it belongs to."""

    def __init__(self) -> None:
        self.of_channel: dict[int, Callable[[bytes], int]] = {}

    def __call__(self, schema: Schema | None, channel: Channel, data: bytes) -> int:
        if channel.id not in self.of_channel:
            self.of_channel[channel.id] = self.reader_of(schema, channel)
        return self.of_channel[channel.id](data)

    @staticmethod
    def reader_of(schema: Schema | None, channel: Channel) -> Callable[[bytes], int]:
        if channel.message_encoding == "protobuf" and schema:
            files = descriptor_pb2.FileDescriptorSet.FromString(schema.data)
            pool = descriptor_pool.DescriptorPool()
            for file in files.file:
                pool.Add(file)
            message = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
            return lambda data: message.FromString(data).episode
        decode = {"json": json.loads, "cbor": cbor2.loads, "msgpack": msgpack.unpackb}.get(channel.message_encoding)
        if decode is None:
            raise SystemExit(f"{channel.topic}: encoding {channel.message_encoding!r} has no steps that can be cut")
        return lambda data: decode(data)["episode"]


def chunking(reader: McapReader) -> tuple[CompressionType, int]:
    """Compression and size limit of the chunks. The limit is not in the file: writers close a chunk on the message
    that passes it, so it is taken as the power of two below every chunk but the last."""
    summary = reader.get_summary()
    chunks = summary.chunk_indexes if summary else []
    if not chunks:
        return CompressionType.NONE, MAX_CHUNK_SIZE
    full = [chunk.uncompressed_size for chunk in chunks[:-1]]
    size = 1 << (min(full).bit_length() - 1) if full else MAX_CHUNK_SIZE
    return COMPRESSIONS[chunks[0].compression], min(size, MAX_CHUNK_SIZE)


def cut_metadata(metadata: dict[str, str], present: list[int], kept: list[int]) -> dict[str, str]:
    """Keeps the entries of the kept episodes in each list that has one per episode."""
    result = dict(metadata)
    for key in PER_EPISODE:
        values = json.loads(metadata.get(key, "null"))
        if isinstance(values, list) and len(values) == len(present):
            result[key] = json.dumps([value for value, episode in zip(values, present) if episode in kept])
    return result


def copy_channel(writer: Writer, schema: Schema | None, channel: Channel) -> int:
    """Registers a channel and its schema as they were; returns the channel's new id."""
    schema_id = writer.register_schema(schema.name, schema.encoding, schema.data) if schema else 0
    return writer.register_channel(channel.topic, channel.message_encoding, schema_id, channel.metadata)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True, help="the recording to write")
    parser.add_argument("--episodes", type=int, nargs="+", required=True, help="numbers of the episodes to keep")
    args = parser.parse_args()
    cut(args.recording, args.output, args.episodes)


if __name__ == "__main__":
    main()
