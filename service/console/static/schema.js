// Fields of a form, and the rules for them, from the service's own OpenAPI document.
import { getJson } from "./api.js";

let loading;

/** The OpenAPI document. */
export const loadSchema = () => (loading ??= getJson("/openapi.json").catch((error) => ((loading = null), Promise.reject(error))));

/** A property's schema without references: {type, enum, minimum, ..., nullable, description, default}. */
export function plain(document, property) {
  const { $ref, anyOf, ...own } = property;
  if ($ref) return { ...plain(document, document.components.schemas[$ref.split("/").pop()]), ...own };
  if (!anyOf) return own;
  const kinds = anyOf.filter((each) => each.type !== "null");
  const one = kinds.length === 1 ? plain(document, kinds[0]) : { anyOf: kinds };
  return { ...one, ...own, nullable: kinds.length < anyOf.length || own.nullable };
}

/** Fields of an object schema as [{name, schema}]. */
export const fields = (document, schema) =>
  Object.entries(schema.properties ?? {}).map(([name, property]) => ({ name, schema: plain(document, property) }));

/** Of an answer's parameters, which has all, those that differ from nothing said. */
export function said(document, params) {
  const { properties } = document.components.schemas.Parameters;
  const same = (name, value) => JSON.stringify(value) === JSON.stringify(properties[name]?.default ?? null);
  return Object.fromEntries(Object.entries(params ?? {}).filter(([name, value]) => value !== null && !same(name, value)));
}

/** What is wrong with a value: [key, values] of a sentence, or null. */
export function fault(schema, value) {
  if (value === undefined || value === null || value === "") return null;
  if (schema.type === "number" || schema.type === "integer") {
    if (!Number.isFinite(value)) return ["fault.number", {}];
    if (schema.type === "integer" && !Number.isInteger(value)) return ["fault.integer", {}];
    const [low, high] = [schema.minimum ?? -Infinity, schema.maximum ?? Infinity];
    if (value < low || value > high)
      return high > 1e9 ? ["fault.least", { low }] : ["fault.range", { low, high }];
  }
  if (typeof value === "string") {
    const length = [...value].length;
    if (schema.maxLength !== undefined && length > schema.maxLength)
      return ["fault.long", { most: schema.maxLength, length }];
    if (schema.minLength !== undefined && length < schema.minLength) return ["fault.short", { least: schema.minLength }];
    if (schema.pattern && !new RegExp(schema.pattern, "u").test(value)) return ["fault.pattern", {}];
  }
  if (schema.enum && !schema.enum.includes(value)) return ["fault.choice", {}];
  return null;
}

/** All faults of an object's values, by dotted names. */
export function faults(document, schema, values, prefix = "") {
  const found = {};
  for (const { name, schema: each } of fields(document, schema)) {
    const value = values[name];
    if (each.type === "object" && value) Object.assign(found, faults(document, each, value, `${prefix}${name}.`));
    const wrong = fault(each, value);
    if (wrong) found[prefix + name] = wrong;
  }
  return found;
}
