// A job: how it goes, and what came of it.
import { Problem, follow, getJson, request, save } from "./api.js";
import { SphereMap } from "./charts.js";
import { CopiesTab } from "./copies-tab.js";
import { ExplainTab, showLayers } from "./explain-tab.js";
import { Filmstrip } from "./filmstrip.js";
import { html, useEffect, useMemo, useRef, useState } from "./html.js";
import { Facts, Icon, Meter, Notice, ProblemCard, Sentence, State, Tabs, active, useDrop } from "./parts.js";
import { regionsOf } from "./regions.js";
import { loadSchema, said } from "./schema.js";
import { ACCEPT, look, useSeen } from "./seen.js";
import { ApiTab } from "./snippets.js";
import { Stage } from "./stage.js";
import { draft, originals } from "./store.js";
import { bytes, length, moment, number, percent, t } from "./text.js";
import { PATH } from "./watermark-page.js";

const STAGES = ["reading", "lettering", "placing", "embossing", "writing", "reporting", "rendering", "evaluating"];
const PAPER = { ray: 0.74, coverage: 0.71, ocr: 0.62 }; // the paper's method, means over 22 assets: the manual's page "The benchmark"

/** A job and its further course. */
export function useJob(self) {
  const [job, setJob] = useState(null);
  const [problem, setProblem] = useState(null);
  useEffect(() => {
    const stop = new AbortController();
    const { signal } = stop;
    const load = async () => {
      const now = await getJson(self, { signal });
      if (!signal.aborted) setJob(now);
      return now;
    };
    const run = async () => {
      setJob(null);
      setProblem(null);
      const first = await load();
      if (!active(first)) return;
      if (!first.links.events) return poll(load, signal); // a verification by somebody without a key has none
      let asked = "";
      await follow(first.links.events, (heard) => {
        setJob((old) => ({ ...old, ...heard }));
        // Events have no links: the model is there before the job has ended.
        if (heard.stage !== asked && ["rendering", "evaluating"].includes(heard.stage)) load().catch(() => {});
        asked = heard.stage;
      }, signal);
      if (!signal.aborted) await load();
    };
    run().catch((error) => signal.aborted || setProblem(error instanceof Problem ? error : new Problem({ code: "unreachable", local: true })));
    return () => stop.abort();
  }, [self]);
  return [job, problem];
}

async function poll(load, signal) {
  do await new Promise((wait) => setTimeout(wait, 1500));
  while (!signal.aborted && active(await load()));
}

/** What a link of a job leads to, read once it is there. */
export function useContent(path, read, failed) {
  const [content, setContent] = useState(null);
  useEffect(() => {
    setContent(null);
    if (!path) return;
    const stop = new AbortController();
    request(path, { signal: stop.signal }).then(read).then((value) => stop.signal.aborted || setContent(value), (error) => stop.signal.aborted || failed(error));
    return () => stop.abort();
  }, [path]);
  return content;
}

/** The address of a picture that may need a key. */
export function usePicture(path) {
  const [url, setUrl] = useState(null);
  useEffect(() => {
    setUrl(null);
    if (!path) return;
    let made;
    const stop = new AbortController();
    request(path, { signal: stop.signal }).then((response) => response.blob()).then((blob) => {
      if (stop.signal.aborted) return;
      made = URL.createObjectURL(blob);
      setUrl(made);
    }, () => {});
    return () => {
      stop.abort();
      if (made) URL.revokeObjectURL(made);
    };
  }, [path]);
  return url;
}

export function Progress({ job, onCancel, stages }) {
  const at = stages.indexOf(job.stage);
  return html`
    <section aria-label=${t("job.progress")}>
      <div class="progress" role="status">
        <progress max="1" value=${job.state === "queued" ? null : job.progress} aria-label=${t("job.progress")}></progress>
        <span>${job.state === "queued" ? t("state.queued") : t(`stage.${job.stage}`, {}, t("state.running"))}</span>
      </div>
      <ol class="stages">
        ${stages.map((name, index) => html`
          <li class=${index < at ? "done" : index === at ? "now" : ""} aria-current=${index === at ? "step" : null}>
            <span class="bullet">${index < at && html`<${Icon} name="check" />`}</span>${t(`stage.${name}`)}</li>`)}
      </ol>
      <button type="button" onClick=${onCancel}>${t("job.cancel")}</button>
    </section>`;
}


export function JobPage({ id, go }) {
  const self = `${PATH}/${encodeURIComponent(id)}`;
  const [job, loadProblem] = useJob(self);
  const [layout, setLayout] = useState("split");
  const [tab, setTab] = useState("result");
  const [current, setCurrent] = useState(-1);
  const [original, setOriginal] = useState(() => originals.get(self) ?? null);
  const wasSent = original !== null && original === originals.get(self);
  const [problem, setProblem] = useState(null);
  const [schema, setSchema] = useState(null);
  useEffect(() => { loadSchema().then(setSchema, setProblem); }, []);
  const links = job?.links ?? {};
  const name = job?.input?.filename ?? original?.name ?? "";
  const stem = name.replace(/\.[^.]*$/, "");

  const result = useContent(links.model, async (response) => new File([await response.blob()], "result.glb"), setProblem);
  const { model: after, notShown: missing, doing: reading } = useSeen(result, true); // what carries no mark stays compressed
  const before = useSeen(original, wasSent && result !== null); // behind the job, whose result is waited for
  const report = useContent(job?.state === "succeeded" ? links.report : null, (response) => response.json(), setProblem);
  const explanation = useContent(tab === "explain" ? links.explanation : null, (response) => response.json(), setProblem);
  const layers = useContent(tab === "explain" ? links.layers : null, async (response) => {
    const seen = await look(new File([await response.blob()], "layers.glb"));
    return seen.model?.object;
  }, setProblem);
  const [visible, setVisible] = useState(["marks", "refused"]);
  const viewer = useRef(null);
  useEffect(() => {
    if (!layers) return;
    showLayers(layers, visible);
    viewer.current?.invalidate();
  }, [layers, visible]);
  useEffect(() => { if (layers) viewer.current?.fit(); }, [layers]); // boxes stand all over it
  const preview = usePicture(job?.state === "succeeded" ? links.preview : null);
  const marks = useMemo(() => report?.watermarks ?? [], [report]);

  const remove = async () => {
    try {
      await request(self, { method: "DELETE" });
      go(active(job) ? "#/" : "#/jobs");
    } catch (error) {
      setProblem(error);
    }
  };
  const params = schema && job ? said(schema, job.parameters) : {};
  const again = () => {
    const { keep_out: _, prefer: __, ...others } = params;
    Object.assign(draft, { file: original, params: { text: "", ...others }, regions: regionsOf(job.parameters) });
    go("#/");
  };
  useDrop((file) => after && setOriginal(file));

  if (loadProblem) return html`<main class="narrow" id="main" tabindex="-1"><${ProblemCard} problem=${loadProblem} /></main>`;
  if (!job) return html`<main class="narrow" id="main" tabindex="-1"><p class="quiet" role="status">${t("loading")}</p></main>`;

  const shown = after || before.model;
  const explaining = tab === "explain" && layers;
  return html`
    <main class="work" id="main" tabindex="-1">
      <section class="stage" aria-label=${t("view.label")}>
        <${Stage} before=${explaining ? null : before.model?.object} after=${explaining || after?.object} marks=${after ? marks : []}
          current=${current} onMark=${setCurrent} layout=${layout} onLayout=${setLayout} viewerRef=${viewer}>
          ${!shown && html`<div class="card"><${Icon} name="cube" /><p>${reading ? t(reading.step) : missing ? t(missing.key, missing.values) : t(active(job) ? "job.soon" : "job.nothing")}</p></div>`}
        <//>
        <div class="caption">
          <strong>${name}</strong>
          ${after && !before.model && !before.doing && html`
            <label class="button small" for="original">${t("job.original")}</label>
            <input id="original" class="hidden-input" type="file" accept=${ACCEPT} onChange=${(event) => event.target.files[0] && setOriginal(event.target.files[0])} />`}
          ${after && original && !wasSent && before.show && !before.doing && html`
            <button type="button" class="small" onClick=${before.show}><${Icon} name="eye" /> ${t("notshown.show")}</button>`}
          ${after && before.notShown && !before.show && html`<span class="quiet">${t(before.notShown.key, before.notShown.values)}</span>`}
          ${before.doing && html`<span class="quiet" role="status">${t("job.original.reading")}</span>`}
        </div>
      </section>
      <aside class="panel">
        <div class="row spread head"><h1>${t("job.title")}</h1><${State} state=${job.state} /></div>
        ${(problem ?? before.problem) && html`<${ProblemCard} problem=${problem ?? before.problem} />`}
        ${active(job) && html`<${Progress} job=${job} stages=${STAGES} onCancel=${remove} />`}
        ${job.state === "failed" && html`<${ProblemCard} problem=${job.error}>
          <button type="button" class="primary" onClick=${again}>${t("job.again")}</button><//>`}
        ${["canceled", "expired"].includes(job.state) && html`<p>${t(`job.${job.state}`)}</p>`}
        ${job.state === "succeeded" && html`
          <${Tabs} tabs=${[["result", t("tab.result")], ["report", t("tab.report")], ...(links.explanation ? [["explain", t("tab.explain")]] : []), ...(links.plan ? [["copies", t("tab.copies")]] : []), ["api", t("tab.api")]]} current=${tab} onChange=${setTab}>
            ${tab === "result" && html`<${Result} job=${job} report=${report} stem=${stem} preview=${preview} current=${current} onMark=${setCurrent} onProblem=${setProblem} />`}
            ${tab === "report" && report && html`<${Details} job=${job} report=${report} marks=${marks} current=${current} onMark=${setCurrent} object=${after?.object} viewer=${viewer} />`}
            ${tab === "explain" && html`<${ExplainTab} facts=${explanation} object=${layers} visible=${visible} onVisible=${setVisible} current=${current} onMark=${setCurrent} />`}
            ${tab === "copies" && html`<${CopiesTab} job=${job} stem=${stem} />`}
            ${tab === "api" && html`<${ApiTab} call=${{ path: PATH, parts: [["file", name]], params, result: { link: "model", name: `${stem}.watermarked.glb` } }} />`}
          <//>
          <div class="row wrap foot"><button type="button" onClick=${again}>${t("job.change")}</button>
            <button type="button" class="danger" onClick=${remove}><${Icon} name="trash" /> ${t("job.delete")}</button></div>`}
      </aside>
    </main>`;
}

const still = window.matchMedia("(prefers-reduced-motion: reduce)").matches;

function Result({ job, report, stem, preview, current, onMark, onProblem }) {
  const turning = usePicture(still ? job.links.poster : job.links.turntable);
  const get = (kind, ending) => job.links[kind] && html`
    <button type="button" class=${kind === "model" ? "primary" : ""} onClick=${() => save(job.links[kind], stem + ending).catch(onProblem)}>
      <${Icon} name="download" /> ${t(`download.${kind}`)}</button>`;
  return html`
    <div class="downloads">
      ${get("model", ".watermarked.glb")}${get("preview_model", ".watermarked.preview.glb")}${report?.export && get("export", `.watermarked.${report.export.format.split("+").pop()}`)}${get("report", ".watermarked.report.json")}${get("preview", ".watermarked.png")}${get("turntable", ".turntable.webp")}${get("credentials", ".watermarked.c2pa")}${get("preview_manifest", ".watermarked.preview.c2pa")}
    </div>
    ${!report && html`<p class="quiet" role="status">${t("loading")}</p>`}
    ${report && html`
      <${Sentences} report=${report} />
      ${report.warnings.map((notice) => html`<${Notice} notice=${notice} />`)}
      <h2>${t("marks.title", { n: report.watermarks.length })}</h2>
      <ol class="marks">
        ${report.watermarks.map((mark, index) => html`
          <li><button type="button" class=${index === current ? "on" : ""} aria-pressed=${String(index === current)} onClick=${() => onMark(index)}>
            <span class="swatch" style=${{ background: mark.color ?? "transparent" }}></span>
            <span>${mark.lines?.join(" / ") || mark.text || t("marks.logo")}</span>
            <span class="quiet">${t("marks.views", { n: mark.views })}</span></button></li>`)}
      </ol>`}
    ${turning && html`<h2>${t("download.turntable")}</h2><img class="preview" src=${turning} alt=${t("turntable.alt")} />`}
    ${preview && html`<h2>${t("download.preview")}</h2><img class="preview" src=${preview} alt=${t("preview.alt")} />`}`;
}

function Sentences({ report }) {
  const { watermark_quality: quality, asset_utility: cost } = report.metrics ?? {};
  const { asset, model } = report;
  const n = report.watermarks.length;
  const lines = [];
  if (!n) lines.push(t("say.label"));
  else lines.push(t("say.marks", { n, text: report.watermarks[0].text || t("marks.logo") }));
  if (quality?.coverage !== null && quality?.coverage !== undefined) lines.push(t("say.coverage", { share: percent(quality.coverage) }));
  if (quality?.ocr !== null && quality?.ocr !== undefined) lines.push(t("say.ocr", { share: percent(quality.ocr) }));
  if (quality?.crop_survival !== null && quality?.crop_survival !== undefined) lines.push(t("say.crop", { share: percent(quality.crop_survival) }));
  if (cost?.smse !== null && cost?.smse !== undefined) lines.push(t("say.smse", { share: percent(cost.smse / report.units.model_size, 4) }));
  if (cost?.ipe !== null && cost?.ipe !== undefined) lines.push(t(cost.ipe === 0 ? "say.parts" : "say.partschanged", { n: cost.ipe }));
  if (asset?.faces && model?.faces) lines.push(t("say.faces", { before: number(asset.faces), after: number(model.faces) }));
  return html`<p class="said" data-test="said">${lines.join(t("say.space"))}</p>`;
}

function Details({ job, report, marks, current, onMark, object, viewer }) {
  const quality = report.metrics?.watermark_quality ?? {};
  const cost = report.metrics?.asset_utility ?? {};
  const shares = ["ray", "coverage", "ocr", "match", "crop_survival"].filter((name) => typeof quality[name] === "number");
  const seconds = Object.values(report.timings).reduce((sum, each) => sum + each, 0);
  const longest = Math.max(...Object.values(report.timings));
  return html`
    ${marks.length > 0 && html`<h2>${t("sphere.title")}</h2><${SphereMap} marks=${marks} current=${current} onMark=${onMark} />`}
    ${shares.length > 0 && html`
      <h2>${t("quality.title")}</h2>
      ${shares.map((name) => html`<${Meter} label=${t(`metric.${name}`)} share=${quality[name]} text=${percent(quality[name])} tick=${PAPER[name]}
        tickText=${PAPER[name] && t("metric.paper", { share: percent(PAPER[name]) })} />`)}
      <p class="hint">${t("metric.tick")}</p>`}
    ${report.metrics?.views && html`<${Filmstrip} views=${report.metrics.views} object=${object} viewer=${viewer} />`}
    <h2>${t("cost.title")}</h2>
    <${Facts} rows=${[
      report.asset.faces && report.model.faces && [t("fact.faces"), `${number(report.asset.faces)} → ${number(report.model.faces)}`],
      [t("fact.size"), `${bytes(report.asset.bytes)} → ${bytes(report.model.bytes)}`],
      report.asset.watertight !== undefined && report.model.watertight !== undefined && [t("fact.watertight"), `${t(`yes.${report.asset.watertight}`)} → ${t(`yes.${report.model.watertight}`)}`],
      typeof cost.smse === "number" && [t("metric.smse"), percent(cost.smse / report.units.model_size, 4)],
      typeof cost.ss === "number" && [t("metric.ss"), percent(cost.ss, 1)],
      typeof cost.ipe === "number" && [t("metric.ipe"), number(cost.ipe)],
    ]} />
    ${report.metrics && Object.keys(report.metrics.missing).length > 0 && html`
      <details class="group"><summary>${t("missing.title")}</summary>
        ${Object.entries(report.metrics.missing).map(([name, notice]) => html`<p class="hint"><code>${name}</code> ${t(`code.${notice.code}`, {}, t("notice"))}: <span lang="en"><${Sentence} text=${`${notice.message} ${notice.remedy}`} /></span></p>`)}</details>`}
    <h2>${t("time.title", { seconds: number(seconds, 1) })}</h2>
    ${Object.entries(report.timings).map(([name, value]) => html`<${Meter} label=${t(`stage.${name}`)} share=${value / longest} text=${`${number(value, 2)} s`} />`)}
    <h2>${t("job.facts")}</h2>
    <${Facts} rows=${[
      [t("fact.sent"), moment(job.created_at)],
      job.expires_at && [t("fact.expires"), moment(job.expires_at)],
      job.copy_of && [t("fact.copyof"), html`<a href=${`#/jobs/${job.copy_of}`}><code class="hash">${job.copy_of}</code></a>`],
      [t("fact.cached"), t(`yes.${job.cached}`)],
      [t("fact.fonts"), report.fonts.map((font) => font.name).join(", ") || "–"],
      [t("fact.engine"), `${report.engine.version} · ${report.engine.device}`],
      ["SHA-256", html`<code class="hash">${report.model.sha256}</code>`],
      ["ID", html`<code class="hash">${job.id}</code>`],
    ]} />`;
}
