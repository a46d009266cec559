// Fields made from the API's own schema.
import { Icon } from "./parts.js";
import { html, useRef } from "./html.js";
import { fields } from "./schema.js";
import { has, t } from "./text.js";

const GROUPS = {
  setting: ["qr", "logo_position", "wrap", "align", "line_spacing", "letter_spacing", "direction", "language"],
  shape: ["mode", "profile", "size", "size_exact", "relief", "count"],
  labels: ["declaration", "metadata_only"],
};
// Those that have a place of their own on the page.
const ELSEWHERE = ["text", "label", "preset", "strength", "color", "keep_out", "prefer"];

const words = (name) => name.replaceAll("_", " ").replace(/^./, (first) => first.toUpperCase());
export const labelOf = (name) => t(`param.${name}`, {}, words(name));
export const valueOf = (value) => t(`value.${value}`, {}, String(value));

/** Enter in a line of text takes what it says, and sends nothing: a job is sent by its button. */
export function sendsNothing(event) {
  if (event.key !== "Enter" || !["text", "radio"].includes(event.target.type)) return;
  event.preventDefault();
  event.target.dispatchEvent(new Event("change", { bubbles: true }));
}

/** One field: label, control, hint, fault. */
export function Field({ name, label, hint, fault, children }) {
  return html`
    <div class=${`field ${fault ? "wrong" : ""}`}>
      <label for=${name}>${label}</label>
      ${children}
      ${fault && html`<p class="fault" id=${`${name}-fault`}>${t(...fault)}</p>`}
      ${hint && html`<p class="hint" id=${`${name}-hint`}>${hint}</p>`}
    </div>
  `;
}

function Control({ id, schema, value, wrong, onChange }) {
  const shared = { id, "aria-invalid": String(Boolean(wrong)), "aria-describedby": `${id}-hint` };
  const standard = schema.default ?? null;
  if (schema.enum || schema.type === "boolean") {
    const options = schema.enum ?? [true, false];
    const parse = (text) => (text === "" ? undefined : schema.enum ? text : text === "true");
    return html`
      <select ...${shared} value=${value === undefined ? "" : String(value)} onChange=${(event) => onChange(parse(event.target.value))}>
        <option value="">${standard === null ? t("field.preset") : t("field.default", { value: valueOf(standard) })}</option>
        ${options.map((option) => html`<option value=${String(option)}>${valueOf(option)}</option>`)}
      </select>`;
  }
  if (schema.type === "number" || schema.type === "integer") {
    const parse = (text) => (text.trim() === "" ? undefined : Number(text));
    return html`
      <input ...${shared} type="text" inputmode="decimal" value=${value ?? ""} placeholder=${standard ?? t("field.automatic")}
        onInput=${(event) => onChange(parse(event.target.value))} />`;
  }
  return html`
    <input ...${shared} type="text" value=${value ?? ""} placeholder=${schema.examples?.[0] ?? ""}
      onInput=${(event) => onChange(event.target.value || undefined)} />`;
}

function Generated({ document, name, schema, values, faults, onChange, path }) {
  const full = path + name;
  const hint = t(`hint.${full}`, {}, schema.description ?? "");
  const english = !has(`hint.${full}`);
  if (schema.type === "object") {
    const inner = values[name] ?? {};
    const change = (key, value) => {
      const next = { ...inner, [key]: value };
      if (value === undefined) delete next[key];
      onChange(name, Object.keys(next).length ? next : undefined);
    };
    return html`
      <details class="group inner">
        <summary>${labelOf(full)}</summary>
        <p class="hint" lang=${english ? "en" : null}>${hint}</p>
        ${fields(document, schema).map((each) => html`<${Generated} key=${each.name} document=${document} ...${each}
          values=${inner} faults=${faults} onChange=${change} path=${`${full}.`} />`)}
      </details>`;
  }
  const id = `field-${full.replaceAll(".", "-")}`;
  return html`
    <${Field} name=${id} label=${labelOf(full)} hint=${hint} fault=${faults[full]}>
      <${Control} id=${id} schema=${schema} value=${values[name]} wrong=${faults[full]} onChange=${(value) => onChange(name, value)} />
    <//>`;
}

/** All parameters that have no place of their own, in groups. */
export function Advanced({ document, schema, values, faults, onChange }) {
  const all = fields(document, schema).filter(({ name }) => !ELSEWHERE.includes(name));
  const placed = Object.values(GROUPS).flat();
  const groups = { ...GROUPS, more: all.map(({ name }) => name).filter((name) => !placed.includes(name)) };
  return Object.entries(groups).map(
    ([group, names]) => html`
      <details class="group" key=${group}>
        <summary>${t(`group.${group}`)}</summary>
        ${names.map((name) => all.find((each) => each.name === name)).filter(Boolean).map((each) => html`
          <${Generated} key=${each.name} document=${document} ...${each} values=${values} faults=${faults} onChange=${onChange} path="" />`)}
      </details>`,
  );
}

/** A file beside the asset. */
export function FileField({ id, label, hint, accept, file, onFile }) {
  const input = useRef();
  return html`
    <div class="field">
      <label for=${id}>${label}</label>
      <div class="file">
        <label class="button" for=${id}><${Icon} name="upload" /> ${file ? file.name : t("file.choose")}</label>
        ${file && html`<button type="button" class="tool plain" aria-label=${t("file.remove", { name: file.name })}
          onClick=${() => { input.current.value = ""; onFile(null); }}><${Icon} name="close" /></button>`}
      </div>
      <input id=${id} ref=${input} class="hidden-input" type="file" accept=${accept} onChange=${(event) => onFile(event.target.files[0] ?? null)} />
      ${hint && html`<p class="hint">${hint}</p>`}
    </div>`;
}

/** Colours of the letters: automatic, those of the surface, or a list. */
export function ColorField({ value, byDefault, onChange }) {
  const shown = value ?? byDefault;
  const kind = shown === "auto" || shown === "none" ? shown : "own";
  const list = kind === "own" ? [shown].flat() : [];
  const set = (colors) => onChange(colors.length === 1 ? colors[0] : colors);
  const choose = { auto: "auto", none: "none", own: "#d02020" };
  return html`
    <fieldset class="field">
      <legend>${labelOf("color")}</legend>
      <div class="choice">
        ${["auto", "none", "own"].map((name) => html`
          <label class=${kind === name ? "on" : ""}>
            <input type="radio" name="color" checked=${kind === name} onChange=${() => onChange(choose[name])} />
            <span>${t(`color.${name}`)}</span>
          </label>`)}
      </div>
      ${kind === "own" && html`
        <div class="colors">
          ${list.map((color, index) => html`
            <span class="color" key=${index}>
              <input type="color" value=${color} aria-label=${t("color.pick", { n: index + 1 })}
                onInput=${(event) => set(list.map((each, at) => (at === index ? event.target.value : each)))} />
              ${list.length > 1 && html`<button type="button" class="tool plain" aria-label=${t("color.remove", { n: index + 1 })}
                onClick=${() => set(list.filter((_, at) => at !== index))}><${Icon} name="close" /></button>`}
            </span>`)}
          ${list.length < 16 && html`<button type="button" class="small" onClick=${() => set([...list, "#f8f8f8"])}>${t("color.add")}</button>`}
        </div>`}
      <p class="hint">${t(`hint.color.${kind}`)}</p>
    </fieldset>`;
}
