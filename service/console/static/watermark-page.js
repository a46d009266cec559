// Choose a file, look at it, say what to emboss, send it.
import { Problem, request, upload } from "./api.js";
import { Advanced, ColorField, Field, FileField, labelOf, sendsNothing, valueOf } from "./form.js";
import { html, useEffect, useMemo, useRef, useState } from "./html.js";
import { Choice, DropZone, Facts, Icon, ProblemCard, Tabs, useDrop } from "./parts.js";
import { Regions, regionParams } from "./regions.js";
import { faults as faultsOf, loadSchema } from "./schema.js";
import { ACCEPT, NotShownCard, fileFacts, useSeen } from "./seen.js";
import { ApiTab } from "./snippets.js";
import { Stage } from "./stage.js";
import { draft, originals } from "./store.js";
import { t } from "./text.js";

export const PATH = "/v1/watermarks";

/** A model to try it with, which comes with the page: Keenan Crane's Spot. */
async function sample() {
  const response = await request(document.querySelector("meta[name=sample]").content);
  return new File([await response.blob()], "spot.glb");
}

export function WatermarkPage({ go }) {
  const [, redraw] = useState(0);
  const change = (values) => {
    Object.assign(draft, values);
    redraw((count) => count + 1);
  };
  const setParam = (name, value) => {
    const params = { ...draft.params, [name]: value };
    if (value === undefined) delete params[name];
    change({ params });
  };
  const [schema, setSchema] = useState(null);
  const [problem, setProblem] = useState(null);
  const [tab, setTab] = useState("form");
  const [sending, setSending] = useState(null); // share that is sent, or null
  const [tried, setTried] = useState(false);
  const [selected, select] = useState(-1);
  const [picking, pick] = useState(null);
  const [found, setFound] = useState([]); // a part that was clicked on: as a node, and as a material
  const viewer = useRef(null);
  const aborter = useRef(null);

  useEffect(() => {
    loadSchema().then(setSchema, setProblem);
    import("./models.js"); // while nobody waits, so that a file is shown as soon as it is there
    import("./viewer.js");
    return () => aborter.current?.abort();
  }, []);

  const open = (file) => {
    change({ file, regions: draft.regions.filter((region) => !region.min) });
    select(-1);
    setProblem(null);
  };
  const over = useDrop(open);

  const { file, params, regions } = draft;
  const seen = useSeen(file);
  const { model, notShown } = seen;
  const parameters = schema?.components.schemas.Parameters;
  const faults = useMemo(() => (schema ? faultsOf(schema, parameters, params) : {}), [schema, params]);
  const sent = { ...params, ...regionParams(regions) };
  if (!sent.text) delete sent.text;
  const lines = params.text?.split("\n").length ?? 1;
  const says = params.text?.trim() || draft.logo || params.qr || params.label || params.metadata_only || params.preset === "provenance";
  const textFault = faults.text ?? (lines > 6 ? ["fault.lines", { most: 6 }] : tried && !says ? ["fault.nothing", {}] : null);
  const wrong = Object.keys(faults).length > 0 || lines > 6;

  const submit = async (event) => {
    event.preventDefault();
    setTried(true);
    setProblem(null);
    if (!file || wrong || !says) {
      document.querySelector(".field.wrong :is(input, select, textarea)")?.focus();
      return;
    }
    const form = new FormData();
    form.set("file", file);
    form.set("params", JSON.stringify(sent));
    if (draft.logo) form.set("logo", draft.logo);
    if (draft.font) form.set("font", draft.font);
    aborter.current = new AbortController();
    setSending(0);
    try {
      const job = await upload(PATH, form, setSending, aborter.current.signal);
      originals.set(job.links.self, file);
      go(`#/jobs/${job.id}`);
    } catch (error) {
      if (error instanceof Problem) setProblem(error);
      else if (error.name !== "AbortError") throw error;
    } finally {
      setSending(null);
    }
  };

  const paper = params.preset === "paper";
  const strengths = ["discreet", "standard", "strong"];
  const parts = [["file", file?.name ?? "model.glb"], draft.logo && ["logo", draft.logo.name], draft.font && ["font", draft.font.name]].filter(Boolean);
  const stem = (file?.name ?? "model.glb").replace(/\.[^.]*$/, "");
  const call = { path: PATH, parts, params: sent, result: { link: "model", name: `${stem}.watermarked.glb` } };
  const onPicked = (part) => {
    const found = ["node", "material"].filter((name) => part[name]).map((name) => ({ kind: picking, [name]: part[name] }));
    if (found.length === 1) take(found[0]);
    else setFound(found);
  };
  const take = (region) => {
    change({ regions: [...regions, region] });
    setFound([]);
    pick(null);
  };

  return html`
    <main class="work" id="main" tabindex="-1">
      <section class=${`stage ${over ? "over" : ""}`} aria-label=${t("view.label")}>
        ${!file && html`<${DropZone} id="asset" title=${t("drop.title")} text=${t("drop.or")} formats="GLB · glTF · OBJ · STL · PLY · OFF · 3MF · DAE · ZIP" accept=${ACCEPT} onFile=${open}>
          <button type="button" class="plain sample" onClick=${() => sample().then(open, setProblem)}>${t("drop.sample")}</button><//>`}
        ${file && html`
          <${Stage} before=${model?.object} boxes=${regions.map((region) => (region.min ? region : null)).filter(Boolean)}
            selected=${selected < 0 ? -1 : regions.filter((each) => each.min).indexOf(regions[selected])} viewerRef=${viewer}
            picking=${picking !== null} onPicked=${onPicked}
            onBox=${(at, box) => {
              const target = regions.filter((each) => each.min)[at];
              change({ regions: regions.map((each) => (each === target ? { ...each, min: box.min, max: box.max } : each)) });
            }}>
            ${notShown && html`<${NotShownCard} seen=${seen}>${seen.show && html`<p class="hint">${t("notshown.later")}</p>`}<//>`}
          <//>
          <div class="caption">
            <strong>${file.name}</strong>
            <label class="button small" for="other">${t("file.other")}</label>
            <input id="other" class="hidden-input" type="file" accept=${ACCEPT} onChange=${(event) => event.target.files[0] && open(event.target.files[0])} />
          </div>`}
        ${over && html`<div class="drop-over"><${Icon} name="upload" /> ${t("drop.now")}</div>`}
      </section>
      <aside class="panel">
        <${Tabs} tabs=${[["form", t("tab.form")], ["api", t("tab.api")]]} current=${tab} onChange=${setTab}>
          ${tab === "api" && html`<${ApiTab} call=${call} />`}
          ${tab === "form" && html`
            <form onSubmit=${submit} onKeyDown=${sendsNothing} novalidate>
              ${file && html`<${Facts} rows=${fileFacts(file, model?.facts ?? notShown?.facts)} />`}
              <${Field} name="text" label=${labelOf("text")} hint=${t("hint.text")} fault=${textFault}>
                <textarea id="text" rows=${Math.max(2, Math.min(lines, 6))} value=${params.text} aria-invalid=${String(Boolean(textFault))}
                  aria-describedby=${textFault ? "text-fault" : "text-hint"} placeholder="SAMPLE" onInput=${(event) => setParam("text", event.target.value)}></textarea>
              <//>
              <${FileField} id="logo" label=${t("file.logo")} accept=".svg" file=${draft.logo} onFile=${(logo) => change({ logo })} />
              <div class="field">
                <span class="label">${labelOf("preset")}</span>
                <${Choice} name="preset" label=${labelOf("preset")} value=${params.preset ?? "merchandise"}
                  options=${["merchandise", "provenance", "paper"].map((name) => [name, valueOf(name)])}
                  onChange=${(name) => change({ params: { ...params, preset: name, ...(name === "paper" ? { strength: "standard" } : {}) } })} />
                <p class="hint">${t(`hint.preset.${params.preset ?? "merchandise"}`)}</p>
              </div>
              <div class="field">
                <span class="label">${labelOf("strength")}</span>
                <${Choice} name="strength" label=${labelOf("strength")} value=${params.strength ?? "standard"} options=${strengths.map((name) => [name, valueOf(name)])}
                  disabled=${(name) => paper && name !== "standard"} onChange=${(name) => setParam("strength", name)} />
                <p class="hint">${t(`hint.strength.${params.strength ?? "standard"}`)}</p>
              </div>
              <${ColorField} value=${params.color} byDefault=${paper ? "none" : "auto"} onChange=${(value) => setParam("color", value)} />
              <${Field} name="label" label=${labelOf("label")} hint=${t("hint.label")}>
                <select id="label" value=${params.label ?? ""} aria-describedby="label-hint" onChange=${(event) => setParam("label", event.target.value || undefined)}>
                  <option value="">${t("label.none")}</option>
                  ${(schema?.components.schemas.Label.enum ?? []).map((name) => html`<option value=${name}>${t(`label.${name}`, {}, name)}</option>`)}
                </select>
              <//>
              <${Regions} regions=${regions} selected=${selected} onSelect=${select} picking=${picking} onPick=${(kind) => { pick(kind); setFound([]); }} found=${found} onTake=${take} possible=${Boolean(model)}
                onChange=${(list) => change({ regions: list })}
                onNew=${(kind) => { change({ regions: [...regions, { kind, ...viewer.current.newBox() }] }); select(regions.length); }} />
              <div class="advanced">
                <h2>${t("group.title")}</h2>
                ${schema && html`<${Advanced} document=${schema} schema=${parameters} values=${params} faults=${faults} onChange=${setParam} />`}
                <details class="group">
                  <summary>${t("file.font")}</summary>
                  <${FileField} id="font" label=${t("file.font")} hint=${t("hint.font")} accept=".ttf,.otf,.ttc" file=${draft.font} onFile=${(font) => change({ font })} />
                </details>
              </div>
              ${(problem ?? seen.problem) && html`<${ProblemCard} problem=${problem ?? seen.problem} />`}
              <div class="submit">
                ${sending === null
                  ? html`<button type="submit" class="primary wide" disabled=${!file}>${t(file ? "send" : "send.first")}</button>`
                  : html`<div class="progress" role="status"><progress max="1" value=${sending} aria-label=${t("sending")}></progress>
                      <span>${t(sending < 1 ? "sending" : "checking")}</span>
                      <button type="button" class="small" onClick=${() => aborter.current.abort()}>${t("cancel")}</button></div>`}
              </div>
            </form>`}
        <//>
      </aside>
    </main>`;
}
