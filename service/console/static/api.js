// The service's own API: requests with a key where one is needed, problems as errors, uploads with progress, events.
const KEY = "meshmark.key";

/** An error that the service (or the way to it) answered with: {code, title, detail, remedy, status}. */
export class Problem extends Error {
  constructor(fields) {
    super(fields.detail ?? fields.code);
    Object.assign(this, fields);
  }
}

let askForKey = async () => null;
export const onKeyNeeded = (ask) => (askForKey = ask);
export const key = () => sessionStorage.getItem(KEY) ?? "";
export function setKey(value) {
  if (value) sessionStorage.setItem(KEY, value);
  else sessionStorage.removeItem(KEY);
}

const authorized = (headers = {}) => (key() ? { ...headers, Authorization: `Bearer ${key()}` } : headers);

export function problemOf(status, text) {
  try {
    const fields = JSON.parse(text);
    if (fields?.code) return new Problem(fields);
  } catch {
    // Not the service's: a proxy answered.
  }
  return new Problem({ code: "unexpected_answer", status, local: true });
}

const unreachable = () => new Problem({ code: "unreachable", status: 0, local: true });

/** A response; a 401 asks for a key once and tries again. */
export async function request(path, options = {}, retried = false) {
  let response;
  try {
    response = await fetch(path, { ...options, headers: authorized(options.headers) });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw unreachable();
  }
  if (response.status === 401 && !retried && (await askForKey())) return request(path, options, true);
  if (!response.ok) throw problemOf(response.status, await response.text());
  return response;
}

export const getJson = async (path, options) => (await request(path, options)).json();

/** Post a form; `progress` is called with the share that is sent. Returns the answer's JSON. */
export async function upload(path, form, progress, signal, retried = false) {
  const sender = new XMLHttpRequest();
  const answer = await new Promise((resolve, reject) => {
    sender.open("POST", path);
    for (const [name, value] of Object.entries(authorized())) sender.setRequestHeader(name, value);
    sender.upload.onprogress = (event) => event.lengthComputable && progress(event.loaded / event.total);
    sender.onload = () => resolve(sender);
    sender.onerror = () => reject(unreachable());
    sender.onabort = () => reject(new DOMException("", "AbortError"));
    signal.addEventListener("abort", () => sender.abort());
    sender.send(form);
  });
  if (answer.status === 401 && !retried && (await askForKey())) return upload(path, form, progress, signal, true);
  if (answer.status >= 300) throw problemOf(answer.status, answer.responseText);
  return JSON.parse(answer.responseText);
}

/** A file as the plain GLB that the service makes of it; `tell` is called with what it is at: {step, share}. */
export async function convert(file, tell, signal) {
  const form = new FormData();
  form.set("file", file);
  let job = await upload("/v1/conversions", form, (share) => tell({ step: share < 1 ? "sending" : "checking", share }), signal);
  const { self } = job.links;
  try {
    for (let pause = 250; ["queued", "running"].includes(job.state); pause = Math.min(pause * 1.5, 2000)) {
      tell({ step: job.state === "queued" ? "notshown.waiting" : "notshown.reading", share: null });
      await new Promise((resolve) => setTimeout(resolve, pause));
      job = await getJson(self, { signal });
    }
    if (job.state !== "succeeded") throw new Problem(job.error ?? { code: "unexpected_answer", local: true });
    return await (await request(job.links.model, { signal })).blob();
  } finally {
    request(self, { method: "DELETE" }).catch(() => {}); // if that is lost, it is deleted within the hour
  }
}

/** Follow a job's events until it has ended; EventSource would send no key. `heard` gets each job as it stood. */
export async function follow(path, heard, signal) {
  let last = "";
  while (!signal.aborted) {
    try {
      const response = await request(path, { signal, headers: last ? { "Last-Event-ID": last } : {} });
      if (response.status === 204) return;
      const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
      for (let text = ""; ; ) {
        const { done, value } = await reader.read();
        if (done) break;
        const blocks = (text + value).split("\n\n");
        text = blocks.pop();
        for (const block of blocks) {
          const field = (name) => block.match(new RegExp(`^${name}: ?(.*)$`, "m"))?.[1];
          if (field("id")) last = field("id");
          if (!field("data")) continue;
          const job = JSON.parse(field("data"));
          heard(job);
          if (!["queued", "running"].includes(job.state)) return;
        }
      }
    } catch (error) {
      if (signal.aborted) return;
      if (error instanceof Problem && error.status >= 400 && error.status < 500 && error.status !== 429) throw error;
    }
    await new Promise((resolve) => setTimeout(resolve, 1000));
  }
}

/** Save what is at a path: by a plain link, or where a key is needed by fetching it. */
export async function save(path, name) {
  const link = document.createElement("a");
  link.download = name;
  link.href = key() ? URL.createObjectURL(await (await request(path)).blob()) : path;
  link.click();
  if (key()) setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}
