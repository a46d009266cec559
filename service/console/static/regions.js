// Where marks may not stand, or rather should: boxes with handles, or parts of the model.
import { html, useState } from "./html.js";
import { Icon } from "./parts.js";
import { t } from "./text.js";

const KINDS = ["keep_out", "prefer"];
const AXES = ["X", "Y", "Z"];

/** As the API takes them: {keep_out: [...], prefer: [...]}, each only where there is one. */
export function regionParams(regions) {
  const of = (kind) => regions.filter((region) => region.kind === kind).map(({ node, material, min, max }) =>
    node ? { node } : material ? { material } : { box: { min, max } });
  return Object.fromEntries(KINDS.map((kind) => [kind, of(kind)]).filter(([, list]) => list.length));
}

/** From parameters back to what is drawn. */
export const regionsOf = (params) =>
  KINDS.flatMap((kind) => (params?.[kind] ?? []).map(({ node, material, box }) => ({ kind, node, material, ...box })));

export function Regions({ regions, selected, onChange, onSelect, onNew, picking, onPick, found, onTake, possible }) {
  const [kind, choose] = useState("keep_out");
  const replace = (index, region) => onChange(regions.map((each, at) => (at === index ? region : each)));
  const remove = (index) => {
    onChange(regions.filter((_, at) => at !== index));
    onSelect(-1);
  };
  const name = (region) => region.node ? t("region.node", { name: region.node }) : region.material ? t("region.material", { name: region.material }) : t("region.box");
  const side = (region, index, end, axis) => html`
    <input type="text" inputmode="decimal" key=${end + axis} value=${region[end][axis]} aria-label=${t(`region.${end}`, { axis: AXES[axis] })}
      onChange=${(event) => {
        const value = Number(event.target.value);
        if (Number.isFinite(value)) replace(index, { ...region, [end]: region[end].map((old, at) => (at === axis ? value : old)) });
      }} />`;
  return html`
    <fieldset class="field">
      <legend>${t("region.title")}</legend>
      <div class="row wrap">
        <select aria-label=${t("region.kind")} value=${kind} onChange=${(event) => choose(event.target.value)} disabled=${!possible}>
          ${KINDS.map((each) => html`<option value=${each}>${t(`region.${each}`)}</option>`)}
        </select>
        <button type="button" class="small" disabled=${!possible} onClick=${() => onNew(kind)}><${Icon} name="cube" /> ${t("region.draw")}</button>
        <button type="button" class="small" disabled=${!possible} aria-pressed=${String(picking !== null)} onClick=${() => onPick(picking === null ? kind : null)}>
          <${Icon} name="pick" /> ${t("region.pick")}</button>
      </div>
      ${picking !== null && html`<p class="hint" role="status">${t(found.length ? "region.which" : "region.click")}</p>`}
      ${found.length > 0 && html`<div class="row wrap which">${found.map((region) => html`
        <button type="button" class="small" onClick=${() => onTake(region)}>${name(region)}</button>`)}</div>`}
      <ul class="regions">
        ${regions.map((region, index) => html`
          <li key=${index} class=${`${region.kind} ${index === selected ? "on" : ""}`}>
            <div class="row spread">
              <button type="button" class="plain" aria-expanded=${region.min ? String(index === selected) : null}
                onClick=${() => region.min && onSelect(index === selected ? -1 : index)}>
                <span class="dot"></span> ${t(`region.${region.kind}`)}: ${name(region)}</button>
              <button type="button" class="tool plain" aria-label=${t("region.remove", { name: name(region) })} onClick=${() => remove(index)}><${Icon} name="trash" /></button>
            </div>
            ${region.min && index === selected && html`
              <div class="sides"><span>${t("region.from")}</span>${[0, 1, 2].map((axis) => side(region, index, "min", axis))}
                <span>${t("region.to")}</span>${[0, 1, 2].map((axis) => side(region, index, "max", axis))}</div>`}
          </li>`)}
      </ul>
      <p class="hint">${t(possible ? "region.hint" : "region.impossible")}</p>
    </fieldset>`;
}
