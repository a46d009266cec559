// Writes the types of an OpenAPI document for TypeScript: node types.mjs OPENAPI TARGET
import { readFile, writeFile } from "node:fs/promises";
import process, { argv, exit } from "node:process";
import openapiTS, { astToString } from "openapi-typescript";
import ts from "typescript";

process.on("uncaughtException", (error) => {
  console.error(error.message);
  exit(1);
});
const [source, target] = argv.slice(2);
const bytes = ts.factory.createTypeReferenceNode("Blob");

const types = await openapiTS(await readFile(source), {
  defaultNonNullable: false, // what has a default may be left out of a request
  rootTypes: true,
  rootTypesNoSchemaPrefix: true,
  rootTypesKeepCasing: true,
  transform: (schema) => (schema.format === "binary" ? bytes : undefined),
});
await writeFile(target, `// Types of Meshmark's API, made from its OpenAPI document by openapi-typescript.\n${astToString(types)}`);
