// Reads GLBs from standard input, each after its length (32 bits, little-endian), and answers each with a line of JSON:
// the Khronos validator's report, or what it threw on a file that breaks it.
import validator from "gltf-validator";

const LENGTH = 4;
const options = { maxIssues: 0, writeTimestamp: false }; // all issues
let chunks = [];
let held = 0;
let needed = LENGTH;
for await (const chunk of process.stdin) {
  chunks.push(chunk);
  held += chunk.length;
  while (held >= needed) {
    const all = Buffer.concat(chunks);
    chunks = [all];
    const end = LENGTH + all.readUInt32LE(0);
    if (held < end) {
      needed = end;
      break;
    }
    const glb = new Uint8Array(all.subarray(LENGTH, end));
    const answer = await validator.validateBytes(glb, options).catch((error) => ({ broken: String(error) }));
    process.stdout.write(JSON.stringify(answer) + "\n");
    chunks = [all.subarray(end)];
    held -= end;
    needed = LENGTH;
  }
}
