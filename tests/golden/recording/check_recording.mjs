// Reads a recording with the reference MCAP reader and a public CDR reader and prints what they see
// as one JSON object; the test beside this file holds it against what was written.
//
//   node check_recording.mjs RECORDING.mcap NODE_MODULES

import { createRequire } from "node:module";
import { readFileSync } from "node:fs";
import path from "node:path";

const [, , recording, modules] = process.argv;
const require = createRequire(path.join(path.resolve(modules), "anchor.js"));
const { McapIndexedReader, McapStreamReader } = require("@mcap/core");
const { parse } = require("@foxglove/rosmsg");
const { MessageReader } = require("@foxglove/rosmsg2-serialization");
const { decompress } = require("fzstd");

const file = readFileSync(recording);
const decompressHandlers = { zstd: (buffer) => decompress(buffer) };
const readable = {
  size: async () => BigInt(file.length),
  read: async (offset, size) => new Uint8Array(file.subarray(Number(offset), Number(offset + size))),
};

// FNV-1a, so that pixels can be compared without printing them.
function hashOf(bytes) {
  let hash = 0x811c9dc5;
  for (const byte of bytes) hash = Math.imul(hash ^ byte, 0x01000193) >>> 0;
  return hash;
}

const plain = (key, value) => {
  if (typeof value === "bigint") return value.toString();
  if (ArrayBuffer.isView(value) && !(value instanceof Uint8Array)) return Array.from(value);
  return value;
};

function readMessage(reader, message) {
  const decoded = reader.readMessage(message.data);
  if (decoded.data instanceof Uint8Array) {
    decoded.data = { bytes: decoded.data.length, hash: hashOf(decoded.data) };
  }
  return decoded;
}

// By the index, as Foxglove and rosbag2 do.
async function readIndexed() {
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
  const readers = new Map();
  const topics = [];
  for (const channel of reader.channelsById.values()) {
    const schema = reader.schemasById.get(channel.schemaId);
    const text = new TextDecoder().decode(schema.data);
    readers.set(channel.id, new MessageReader(parse(text, { ros2: true })));
    topics.push({ topic: channel.topic, schema: schema.name, encoding: channel.messageEncoding });
  }
  const messages = [];
  for await (const message of reader.readMessages({ validateCrcs: true })) {
    messages.push({
      topic: reader.channelsById.get(message.channelId).topic,
      sequence: message.sequence,
      logTime: message.logTime,
      publishTime: message.publishTime,
      message: readMessage(readers.get(message.channelId), message),
    });
  }
  const attachments = [];
  for await (const attachment of reader.readAttachments({ validateCrcs: true })) {
    attachments.push({ name: attachment.name, bytes: attachment.data.length });
  }
  const metadata = [];
  for await (const record of reader.readMetadata()) {
    metadata.push({ name: record.name, values: Object.fromEntries(record.metadata) });
  }
  return {
    profile: reader.header.profile,
    topics,
    messages,
    attachments,
    metadata,
    statistics: {
      messages: reader.statistics.messageCount,
      chunks: reader.statistics.chunkCount,
      indexedChunks: reader.chunkIndexes.length,
    },
  };
}

// From beginning to end, every sum checked, as after a power cut.
function readStream() {
  const reader = new McapStreamReader({ decompressHandlers, validateCrcs: true });
  reader.append(file);
  const counts = {};
  for (let record; (record = reader.nextRecord()); ) {
    counts[record.type] = (counts[record.type] ?? 0) + 1;
  }
  return { counts, whole: reader.done(), left: reader.bytesRemaining() };
}

const indexed = await readIndexed();
console.log(JSON.stringify({ ...indexed, stream: readStream() }, plain));
