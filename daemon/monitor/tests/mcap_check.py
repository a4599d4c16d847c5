"""What the public readers make of a recording and of a live stream, as JSON: the packages mcap, mcap-protobuf-support, websockets.

    mcap_check.py file FILE       channels, schemas, counts, values, metadata
    mcap_check.py cut FILE        how much of a file without an end can be read
    mcap_check.py stream URL N    N messages of each channel
"""

import asyncio
import base64
import json
import struct
import sys

from google.protobuf.json_format import MessageToDict
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, SeekingReader
from mcap.records import Schema
from mcap_protobuf.decoder import DecoderFactory


def bits(message):
    """Every field by its name; numbers as their bits, so that -0.0 and infinities are distinguished."""
    fields = {}
    for descriptor in message.DESCRIPTOR.fields:
        value = getattr(message, descriptor.name)
        # Older releases know the label alone, newer ones warn of it.
        has_label = not hasattr(descriptor, "is_repeated")
        is_repeated = descriptor.label == descriptor.LABEL_REPEATED if has_label else descriptor.is_repeated
        if descriptor.message_type and not is_repeated:
            if message.HasField(descriptor.name):
                fields[descriptor.name] = bits(value)
        elif descriptor.has_presence and not message.HasField(descriptor.name):
            continue
        elif is_repeated:
            fields[descriptor.name] = [number_bits(number) for number in value]
        else:
            fields[descriptor.name] = number_bits(value)
    return fields


def number_bits(value):
    return struct.unpack("<Q", struct.pack("<d", value))[0] if isinstance(value, float) else value


def described(messages):
    """Each topic's schema, count, and own messages' fields; whether the times rise."""
    topics = {}
    for schema, channel, message, decoded in messages:
        topic = topics.setdefault(
            channel.topic, {"schema": schema.name, "rises": True, "newest": -1, "messages": [], "times": []}
        )
        topic["rises"] &= message.log_time > topic["newest"]
        topic["newest"] = message.log_time
        own = not schema.name.startswith("foxglove.")
        topic["messages"].append(bits(decoded) if own else MessageToDict(decoded))
        topic["times"].append(message.log_time)
    return topics


def file(path):
    with open(path, "rb") as stream:
        reader = SeekingReader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        topics = described(reader.iter_decoded_messages(log_time_order=False))
        counts = {
            channel.topic: summary.statistics.channel_message_counts[channel.id]
            for channel in summary.channels.values()
        }
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
    return {"topics": topics, "counts": counts, "metadata": metadata}


def cut(path):
    counts = {}
    end = None
    with open(path, "rb") as stream:
        reader = NonSeekingReader(stream, decoder_factories=[DecoderFactory()])
        try:
            for _, channel, _, _ in reader.iter_decoded_messages(log_time_order=False):
                counts[channel.topic] = counts.get(channel.topic, 0) + 1
        except (McapError, EOFError, struct.error) as error:
            end = repr(error)
    return {"counts": counts, "end": end}


async def stream(url, wanted):
    import websockets

    channels, subscriptions, messages = {}, {}, {}
    async with websockets.connect(url, subprotocols=["foxglove.sdk.v1"], max_size=None, close_timeout=0.5) as socket:
        result = {"subprotocol": socket.subprotocol}
        while not messages or min(len(m["messages"]) for m in messages.values()) < wanted:
            received = await asyncio.wait_for(socket.recv(), 60)
            if isinstance(received, str):
                said = json.loads(received)
                if said["op"] == "serverInfo":
                    result["server"] = said
                if said["op"] == "advertise":
                    for channel in said["channels"]:
                        if not channel["topic"].startswith("/vehicle/") or channel["topic"].endswith("/log"):
                            continue
                        subscription = len(channels) + 1
                        channels[subscription] = channel
                        messages[channel["topic"]] = {"schema": channel["schemaName"], "messages": [], "times": []}
                        await socket.send(
                            json.dumps(
                                {
                                    "op": "subscribe",
                                    "subscriptions": [{"id": subscription, "channelId": channel["id"]}],
                                }
                            )
                        )
                continue
            if received[0] != 1:
                continue
            subscription, log_time = struct.unpack("<IQ", received[1:13])
            channel = channels[subscription]
            if subscription not in subscriptions:
                schema = Schema(
                    id=subscription,
                    name=channel["schemaName"],
                    encoding=channel["schemaEncoding"],
                    data=base64.b64decode(channel["schema"]),
                )
                subscriptions[subscription] = DecoderFactory().decoder_for(channel["encoding"], schema)
            decoded = subscriptions[subscription](received[13:])
            own = not channel["schemaName"].startswith("foxglove.")
            topic = messages[channel["topic"]]
            topic["messages"].append(bits(decoded) if own else MessageToDict(decoded))
            topic["times"].append(log_time)
    result["topics"] = messages
    return result


if __name__ == "__main__":
    command, arguments = (sys.argv[1:] or [""])[0], sys.argv[2:]
    if command == "file":
        answer = file(*arguments)
    elif command == "cut":
        answer = cut(*arguments)
    elif command == "stream":
        answer = asyncio.run(stream(arguments[0], int(arguments[1])))
    else:
        sys.exit(__doc__)
    json.dump(answer, sys.stdout)
