// Reads GLBs from standard input, each after its length (32 bits, little-endian), and answers each with a line of JSON:
// the Khronos validator's report, or what it threw on a file that breaks it.
import validator from "gltf-validator";

const options = { maxIssues: 0, writeTimestamp: false }; // all issues
let waiting = Buffer.alloc(0);
for await (const chunk of process.stdin) {
  waiting = Buffer.concat([waiting, chunk]);
  while (waiting.length >= 4 && waiting.length >= 4 + waiting.readUInt32LE(0)) {
    const end = 4 + waiting.readUInt32LE(0);
    const glb = new Uint8Array(waiting.subarray(4, end));
    const answer = await validator.validateBytes(glb, options).catch((error) => ({ broken: String(error) }));
    process.stdout.write(JSON.stringify(answer) + "\n");
    waiting = waiting.subarray(end);
  }
}
