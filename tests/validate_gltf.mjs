// Reads a GLB from standard input and prints the Khronos validator's report as JSON.
import { readFileSync } from "node:fs";
import validator from "gltf-validator";

const report = await validator.validateBytes(new Uint8Array(readFileSync(0)), {
  maxIssues: 0, // all of them
  writeTimestamp: false,
});
process.stdout.write(JSON.stringify(report));
