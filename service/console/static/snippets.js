// The request that the form makes, as code.
import { key } from "./api.js";
import { html, useState } from "./html.js";
import { Copy, Choice } from "./parts.js";
import { t } from "./text.js";

const shell = (text) => `'${text.replaceAll("'", `'\\''`)}'`;
const literal = (text) => JSON.stringify(text);

const base = () => location.origin;

export function curl({ path, parts, params }) {
  const lines = [`curl -s ${base()}${path}`];
  if (key()) lines.push(`-H "Authorization: Bearer $MESHMARK_KEY"`);
  for (const [name, file] of parts) lines.push(`-F ${shell(`${name}=@${file}`)}`);
  lines.push(`-F ${shell(`params=${JSON.stringify(params)}`)}`);
  return lines.join(" \\\n     ");
}

const python = (value, indent = "") => {
  if (value === null) return "None";
  if (value === true || value === false) return value ? "True" : "False";
  if (Array.isArray(value)) return `[${value.map((each) => python(each, indent)).join(", ")}]`;
  if (typeof value === "object") return `{${Object.entries(value).map(([name, each]) => `${literal(name)}: ${python(each)}`).join(", ")}}`;
  return JSON.stringify(value);
};

export function httpx({ path, parts, params, result }) {
  return [
    "import json",
    ...(key() ? ["import os"] : []),
    "import time",
    "from pathlib import Path",
    "",
    "import httpx2",
    "",
    key()
      ? `headers = {"Authorization": f"Bearer {os.environ['MESHMARK_KEY']}"}\nclient = httpx2.Client(base_url=${literal(base())}, headers=headers, timeout=60)`
      : `client = httpx2.Client(base_url=${literal(base())}, timeout=60)`,
    `files = {${parts.map(([name, file]) => `${literal(name)}: (${literal(file)}, Path(${literal(file)}).read_bytes())`).join(", ")}}`,
    `params = ${python(params)}`,
    `job = client.post(${literal(path)}, files=files, data={"params": json.dumps(params)}).raise_for_status().json()`,
    `while job["state"] in ("queued", "running"):`,
    "    time.sleep(0.5)",
    `    job = client.get(job["links"]["self"]).raise_for_status().json()`,
    `if job["state"] != "succeeded":`,
    `    raise SystemExit(job["error"])`,
    `Path(${literal(result.name)}).write_bytes(client.get(job["links"][${literal(result.link)}]).raise_for_status().content)`,
    "",
  ].join("\n");
}

export function javascript({ path, parts, params, result }) {
  const auth = key() ? ", { headers }" : "";
  return [
    `import { openAsBlob } from "node:fs";`,
    `import { writeFile } from "node:fs/promises";`,
    "",
    ...(key() ? ["const headers = { Authorization: `Bearer ${process.env.MESHMARK_KEY}` };"] : []),
    `const service = ${literal(base())};`,
    "const form = new FormData();",
    ...parts.map(([name, file]) => `form.set(${literal(name)}, await openAsBlob(${literal(file)}), ${literal(file)});`),
    `form.set("params", JSON.stringify(${JSON.stringify(params)}));`,
    `const answer = await fetch(service + ${literal(path)}, { method: "POST", body: form${key() ? ", headers" : ""} });`,
    "let job = await answer.json();",
    "if (!answer.ok) throw new Error(`${job.detail} ${job.remedy}`);",
    `while (["queued", "running"].includes(job.state)) {`,
    "  await new Promise((wait) => setTimeout(wait, 500));",
    `  job = await (await fetch(service + job.links.self${auth})).json();`,
    "}",
    `if (job.state !== "succeeded") throw new Error(job.error?.detail ?? job.state);`,
    `const result = await fetch(service + job.links[${literal(result.link)}]${auth});`,
    `await writeFile(${literal(result.name)}, Buffer.from(await result.arrayBuffer()));`,
    "",
  ].join("\n");
}

const LANGUAGES = { curl: ["curl", curl], python: ["Python", httpx], javascript: ["JavaScript", javascript] };

/** This very request as code. */
export function ApiTab({ call }) {
  const [name, choose] = useState("curl");
  const text = LANGUAGES[name][1](call);
  return html`
    <div class="api">
      <p class="hint">${t("api.intro")}</p>
      <div class="row spread">
        <${Choice} name="code" label=${t("api.language")} value=${name} options=${Object.entries(LANGUAGES).map(([id, [title]]) => [id, title])} onChange=${choose} />
        <${Copy} text=${text} />
      </div>
      <pre tabindex="0" aria-label=${LANGUAGES[name][0]}><code>${text}</code></pre>
      <p class="hint"><a href="/docs">${t("api.docs")}</a></p>
    </div>`;
}
