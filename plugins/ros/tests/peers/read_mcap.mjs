// Decodes every message of an exported recording with Foxglove's own readers, and prints how many each topic has.
//
//     npm install @mcap/core@2 @foxglove/rosmsg@5 @foxglove/rosmsg2-serialization@3 fzstd@0.1
//     node PATH/TO/read_mcap.mjs out.mcap
//
// The packages are taken from the folder in which it is run. It exits with 1 if a message does not decode, or if their
// number is not that in the file's statistics.

import { readFileSync } from "node:fs";
import { createRequire } from "node:module";

const require = createRequire(`${process.cwd()}/`);
const { McapStreamReader } = require("@mcap/core");
const { parse } = require("@foxglove/rosmsg");
const { MessageReader } = require("@foxglove/rosmsg2-serialization");
const { decompress } = require("fzstd");

const reader = new McapStreamReader({
  decompressHandlers: { zstd: (data, size) => decompress(data, new Uint8Array(Number(size))) },
});
reader.append(readFileSync(process.argv[2]));

const schemas = new Map();
const channels = new Map();
const counts = new Map();
const failures = [];
let expected = 0n;

for (let record; (record = reader.nextRecord()) !== undefined; ) {
  if (record.type === "Schema" && !schemas.has(record.id)) {
    const definitions = parse(new TextDecoder().decode(record.data), { ros2: true });
    schemas.set(record.id, new MessageReader(definitions));
  } else if (record.type === "Channel") {
    channels.set(record.id, record);
  } else if (record.type === "Statistics") {
    expected = record.messageCount;
  } else if (record.type === "Message") {
    const channel = channels.get(record.channelId);
    try {
      schemas.get(channel.schemaId).readMessage(record.data);
      counts.set(channel.topic, (counts.get(channel.topic) ?? 0) + 1);
    } catch (error) {
      failures.push(`${channel.topic}: ${error.message}`);
    }
  }
}

for (const [topic, count] of [...counts].sort()) {
  console.log(`${topic}  ${count}`);
}
const decoded = [...counts.values()].reduce((sum, count) => sum + count, 0);
console.log(`${decoded} of ${expected} messages on ${counts.size} topics decoded; ${failures.length} failed`);
failures.slice(0, 10).forEach((failure) => console.log(failure));
process.exit(failures.length || BigInt(decoded) !== expected || !decoded || !reader.done() ? 1 : 0);
