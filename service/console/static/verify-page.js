// A suspect file, or a picture of one: what can be read on it, and what it says of itself.
import { Problem, key, request, save, upload } from "./api.js";
import { Field, FileField, sendsNothing } from "./form.js";
import { html, useEffect, useMemo, useRef, useState } from "./html.js";
import { Progress, useContent, useJob } from "./job-page.js";
import { DropZone, Facts, Icon, Notice, ProblemCard, State, Tabs, active, useDrop } from "./parts.js";
import { ACCEPT, NotShownCard, fileFacts, useSeen } from "./seen.js";
import { ApiTab } from "./snippets.js";
import { Stage } from "./stage.js";
import { originals } from "./store.js";
import { bytes, length, moment, percent, t } from "./text.js";

const PATH = "/v1/verifications";
const PICTURES = ".png,.jpg,.jpeg,.webp";
const isPicture = (file) => /\.(png|jpe?g|webp)$/i.test(file.name);
const modelOf = (file) => (file && !isPicture(file) ? file : null);

function useObjectUrl(file) {
  const url = useMemo(() => file && URL.createObjectURL(file), [file]);
  useEffect(() => () => url && URL.revokeObjectURL(url), [url]);
  return url;
}

/** The picture with a ring round what was read. */
function Picture({ file, marks, current }) {
  const url = useObjectUrl(file);
  const [size, setSize] = useState(null);
  const mark = marks[current];
  return html`
    <div class="picture"><div class="picture-frame">
      <img src=${url} alt=${file.name} onLoad=${(event) => setSize([event.target.naturalWidth, event.target.naturalHeight])} />
      ${size && html`<svg viewBox=${`0 0 ${size[0]} ${size[1]}`} aria-hidden="true">
        ${marks.filter((each) => each.pixel).map((each) => html`<circle class=${each === mark ? "on" : ""} cx=${each.pixel[0]} cy=${each.pixel[1]} r=${Math.max(...size) / 40} />`)}</svg>`}
    </div></div>`;
}

function Shown({ file, seen, marks = [], current = -1, onMark }) {
  const shown = useMemo(() => marks.filter((mark) => mark.center).map((mark) => ({ ...mark, text: mark.text, size: [mark.length ?? 0.1] })), [marks]);
  if (file && isPicture(file)) return html`<${Picture} file=${file} marks=${marks} current=${current} />`;
  return html`
    <${Stage} before=${seen.model?.object} marks=${seen.model ? shown : []} current=${current} onMark=${onMark}>
      ${seen.notShown ? html`<${NotShownCard} seen=${seen} />`
        : !seen.model && html`<div class="card"><${Icon} name="cube" /><p>${t(file ? "loading" : "verify.notkept")}</p></div>`}
    <//>`;
}

export function VerifyPage({ go }) {
  const [file, setFile] = useState(null);
  const [original, setOriginal] = useState(null);
  const [credentials, setCredentials] = useState(null);
  const [texts, setTexts] = useState("");
  const [problem, setProblem] = useState(null);
  const [sending, setSending] = useState(null);
  const [tab, setTab] = useState("form");
  const aborter = useRef(null);
  const seen = useSeen(modelOf(file));
  const open = (chosen) => {
    setFile(chosen);
    setProblem(null);
  };
  const over = useDrop(open);
  useEffect(() => () => aborter.current?.abort(), []);

  const known = texts.split("\n").map((line) => line.trim()).filter(Boolean);
  const fault = known.length > 32 ? ["fault.lines", { most: 32 }] : known.some((text) => text.length > 200) ? ["fault.long", { most: 200, length: Math.max(...known.map((text) => text.length)) }] : null;
  const params = known.length ? { texts: known } : {};
  const submit = async (event) => {
    event.preventDefault();
    if (!file || fault) return;
    const form = new FormData();
    form.set("file", file);
    form.set("params", JSON.stringify(params));
    if (original) form.set("original", original);
    if (credentials) form.set("credentials", credentials);
    aborter.current = new AbortController();
    setProblem(null);
    setSending(0);
    try {
      const job = await upload(PATH, form, setSending, aborter.current.signal);
      originals.set(job.links.self, file);
      go(`#/verifications/${job.id}`);
    } catch (error) {
      if (error instanceof Problem) setProblem(error);
      else if (error.name !== "AbortError") throw error;
    } finally {
      setSending(null);
    }
  };
  const parts = [["file", file?.name ?? "suspect.glb"], original && ["original", original.name], credentials && ["credentials", credentials.name]].filter(Boolean);
  return html`
    <main class="work" id="main" tabindex="-1">
      <section class=${`stage ${over ? "over" : ""}`} aria-label=${t("view.label")}>
        ${!file && html`<${DropZone} id="asset" title=${t("verify.drop")} text=${t("verify.drop.text")} formats="GLB · glTF · OBJ · STL · PLY · OFF · 3MF · DAE · ZIP · PNG · JPEG · WebP" accept=${`${ACCEPT},${PICTURES}`} onFile=${open} />`}
        ${file && html`
          <${Shown} file=${file} seen=${seen} />
          <div class="caption"><strong>${file.name}</strong>
            <label class="button small" for="other">${t("file.other")}</label>
            <input id="other" class="hidden-input" type="file" accept=${`${ACCEPT},${PICTURES}`} onChange=${(event) => event.target.files[0] && open(event.target.files[0])} /></div>`}
        ${over && html`<div class="drop-over"><${Icon} name="upload" /> ${t("drop.now")}</div>`}
      </section>
      <aside class="panel">
        <${Tabs} tabs=${[["form", t("tab.verify")], ["api", t("tab.api")]]} current=${tab} onChange=${setTab}>
          ${tab === "api" && html`<${ApiTab} call=${{ path: PATH, parts, params, result: { link: "report", name: "verification.json" } }} />`}
          ${tab === "form" && html`
            <form onSubmit=${submit} onKeyDown=${sendsNothing} novalidate>
              <p>${t("verify.intro")}</p>
              ${file && html`<${Facts} rows=${fileFacts(file, seen.model?.facts)} />`}
              <${Field} name="texts" label=${t("verify.texts")} hint=${t("verify.texts.hint")} fault=${fault}>
                <textarea id="texts" rows="3" value=${texts} aria-describedby="texts-hint" onInput=${(event) => setTexts(event.target.value)}></textarea><//>
              <${FileField} id="compare" label=${t("verify.original")} hint=${t("verify.original.hint")} accept=${ACCEPT} file=${original} onFile=${setOriginal} />
              <${FileField} id="credentials" label=${t("verify.credentials")} accept=".c2pa" file=${credentials} onFile=${setCredentials} />
              ${(problem ?? seen.problem) && html`<${ProblemCard} problem=${problem ?? seen.problem} />`}
              <div class="submit">
                ${sending === null
                  ? html`<button type="submit" class="primary wide" disabled=${!file}>${t(file ? "verify.send" : "send.first")}</button>`
                  : html`<div class="progress" role="status"><progress max="1" value=${sending} aria-label=${t("sending")}></progress><span>${t(sending < 1 ? "sending" : "checking")}</span>
                      <button type="button" class="small" onClick=${() => aborter.current.abort()}>${t("cancel")}</button></div>`}
              </div>
            </form>`}
        <//>
      </aside>
    </main>`;
}

export function VerificationPage({ id, go }) {
  const self = `${PATH}/${encodeURIComponent(id)}`;
  const [job, loadProblem] = useJob(self);
  const [current, setCurrent] = useState(-1);
  const [problem, setProblem] = useState(null);
  const [file] = useState(() => originals.get(self) ?? null);
  const seen = useSeen(modelOf(file), Boolean(job?.links.events)); // who has no key cannot ask for a conversion
  const report = useContent(job?.state === "succeeded" ? job.links.report : null, (response) => response.json(), setProblem);
  const marks = useMemo(() => report?.marks ?? [], [report]);
  const remove = async () => {
    try {
      await request(self, { method: "DELETE" });
      go("#/verify");
    } catch (error) {
      setProblem(error);
    }
  };
  if (loadProblem) return html`<main class="narrow" id="main" tabindex="-1"><${ProblemCard} problem=${loadProblem} /></main>`;
  if (!job) return html`<main class="narrow" id="main" tabindex="-1"><p class="quiet" role="status">${t("loading")}</p></main>`;
  const name = file?.name ?? job.input?.filename ?? "";
  return html`
    <main class="work" id="main" tabindex="-1">
      <section class="stage" aria-label=${t("view.label")}>
        <${Shown} file=${file} seen=${seen} marks=${marks} current=${current} onMark=${setCurrent} />
        ${name && html`<div class="caption"><strong>${name}</strong></div>`}
      </section>
      <aside class="panel">
        <div class="row spread head"><h1>${t("verify.title")}</h1><${State} state=${job.state} /></div>
        ${(problem ?? seen.problem) && html`<${ProblemCard} problem=${problem ?? seen.problem} />`}
        ${active(job) && html`<${Progress} job=${job} stages=${["reading"]} onCancel=${remove} />`}
        ${job.state === "failed" && html`<${ProblemCard} problem=${job.error} />`}
        ${["canceled", "expired"].includes(job.state) && html`<p>${t(`job.${job.state}`)}</p>`}
        ${report && html`
          <${Answers} report=${report} marks=${marks} current=${current} onMark=${setCurrent} />
          <div class="downloads">
            ${key()
              ? html`<button type="button" class="primary" onClick=${() => save(job.links.evidence, "evidence.html").catch(setProblem)}><${Icon} name="download" /> ${t("verify.evidence")}</button>`
              : html`<a class="button primary" href=${job.links.evidence} target="_blank" rel="noopener"><${Icon} name="external" /> ${t("verify.evidence")}</a>`}
            <button type="button" onClick=${() => save(job.links.report, "verification.json").catch(setProblem)}><${Icon} name="download" /> ${t("download.report")}</button>
          </div>
          <${Facts} rows=${[[t("fact.size"), bytes(report.file.bytes)], [t("fact.format"), report.file.format], [t("fact.sent"), moment(job.created_at)],
            ["SHA-256", html`<code class="hash">${report.file.sha256}</code>`]]} />`}
        ${job.state === "succeeded" && html`<div class="row wrap foot"><a class="button" href="#/verify">${t("verify.again")}</a>
          <button type="button" class="danger" onClick=${remove}><${Icon} name="trash" /> ${t("job.delete")}</button></div>`}
      </aside>
    </main>`;
}

/** One answer of a layer: a sign, a title, sentences. */
const Answer = ({ good, title, children }) => html`
  <section class=${`answer ${good === true ? "good" : good === false ? "bad" : ""}`}>
    <h2><${Icon} name=${good === true ? "check" : good === false ? "alert" : "cube"} /> ${title}</h2>${children}</section>`;

function Answers({ report, marks, current, onMark }) {
  const { label, credentials, original, found, texts, warnings } = report;
  const trust = { trusted: true, valid: true, expired: null, tampered: false, absent: null };
  const said = label && Object.entries(label).filter(([, value]) => value && !Array.isArray(value));
  const there = original?.marks.filter((mark) => mark.present).length;
  return html`
    <${Answer} good=${marks.length ? true : null} title=${t("layer.surface")}>
      <p data-test="read">${marks.length ? t("layer.marks.read", { n: marks.length, texts: [...new Set(marks.map((mark) => `“${mark.known ?? mark.text}”`))].join(t("list.comma")) }) : t("layer.marks.none")}</p>
      ${texts?.length > 0 && found?.length < texts.length && html`<p>${t("layer.marks.missing", { texts: texts.filter((text) => !found.includes(text)).map((text) => `“${text}”`).join(t("list.comma")) })}</p>`}
      <ol class="marks">
        ${marks.map((mark, index) => html`
          <li><button type="button" class=${index === current ? "on" : ""} aria-pressed=${String(index === current)} onClick=${() => onMark(index)}>
            <span>${mark.text}</span><span class="quiet">${t("layer.mark", { share: percent(mark.confidence), n: mark.votes })}</span></button></li>`)}
      </ol>
    <//>
    <${Answer} good=${label ? true : null} title=${t("layer.metadata")}>
      ${label ? html`<${Facts} rows=${[...said.map(([name, value]) => [t(`said.${name}`, {}, name), value]),
          ...label.aigc.map((each) => ["AIGC", each.text ?? Object.entries(each.fields).filter(([, value]) => value).map(([name, value]) => `${name}: ${value}`).join("; ")])]} />`
        : html`<p>${t("layer.metadata.none")}</p>`}
    <//>
    <${Answer} good=${credentials ? trust[credentials.state] : null} title=${t("layer.credentials")}>
      <p>${credentials ? t(`credentials.${credentials.state}`, { name: credentials.name ?? credentials.issuer ?? "" }) : t("credentials.unread")}</p>
    <//>
    ${original && html`
      <${Answer} good=${there > 0} title=${t("layer.original")}>
        <p>${t("layer.original.fits", { covered: percent(original.covered), residual: percent(original.residual, 2), scale: length(original.scale) })}</p>
        ${original.marks.length > 0 && html`<p>${t("layer.original.marks", { n: there, all: original.marks.length })}</p>`}
      <//>`}
    ${warnings.map((notice) => html`<${Notice} notice=${notice} />`)}`;
}
