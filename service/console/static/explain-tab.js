// Why marks stand where they stand: the steps of the placement, and what each mark adds and costs.
import { html } from "./html.js";
import { Meter } from "./parts.js";
import { number, t } from "./text.js";

const LEAST = 5e-5; // share of all directions: smaller costs are not told

/** The names of the layers of a model that explains a placement; the asset itself is none. */
export const layersOf = (object) => {
  const names = [];
  object.traverse((part) => part.material?.name && part.material.name !== "asset" && names.push(part.material.name));
  return names;
};

/** Show some layers of that model, and the asset. */
export function showLayers(object, names) {
  object.traverse((part) => { if (part.material?.name) part.visible = part.material.name === "asset" || names.includes(part.material.name); });
}

export function ExplainTab({ facts, object, visible, onVisible, current, onMark }) {
  if (!facts) return html`<p class="quiet" role="status">${t("loading")}</p>`;
  const most = facts.stages[0].left;
  return html`
    <p class="said">${t("explain.said", { marks: facts.marks.length, places: number(facts.stages.at(-1).left), boxes: number(most) })}</p>
    <h2>${t("explain.layers")}</h2>
    ${!object && html`<p class="quiet" role="status">${t("loading")}</p>`}
    ${object && html`<ul class="layers">${layersOf(object).map((name) => html`
      <li><label><input type="checkbox" checked=${visible.includes(name)}
        onChange=${(event) => onVisible(event.target.checked ? [...visible, name] : visible.filter((other) => other !== name))} />
        <span class="swatch" style=${{ background: colorOf(object, name) }}></span>${t(`layer.${name}`)}</label></li>`)}</ul>`}
    <h2>${t("explain.steps")}</h2>
    ${facts.stages.map(({ stage, left, dropped_because: reason }, index) => {
      const gone = index ? facts.stages[index - 1].left - left : 0;
      return html`<${Meter} label=${t(`step.${stage}`)} share=${most ? left / most : 0} text=${number(left)} />
        ${gone > 0 && reason && html`<p class="hint dropped">${t("explain.dropped", { n: number(gone) })} <span lang="en">${reason}.</span></p>`}`;
    })}
    <h2>${t("explain.marks")}</h2>
    <p class="hint">${t("explain.unit")}</p>
    ${facts.marks.map((mark, index) => html`
      <details class="group" open=${index === current}>
        <summary onClick=${(event) => { event.preventDefault(); onMark(index === current ? -1 : index); }}>${t("explain.mark", { n: index + 1, width: number(mark.width, 2), views: mark.views })}</summary>
        <table class="costs"><tbody>${worthOf(mark).map(([name, value]) => html`
          <tr><th scope="row">${t(`term.${name}`)}</th><td>${value > 0 ? "+" : "−"}${number(Math.abs(value), 4)}</td></tr>`)}</tbody></table>
      </details>`)}
    ${facts.refused.length > 0 && html`<h2>${t("explain.refused")}</h2>
      <ul>${facts.refused.map((one) => html`<li lang="en">${number(one.width, 2)}: ${one.because}</li>`)}</ul>`}`;
}

// What a mark adds, then what it costs, the dearest first.
function worthOf(mark) {
  const costs = Object.entries({ ...mark.costs, beside_others: mark.beside_others }).filter(([, value]) => Math.abs(value) >= LEAST);
  costs.sort((one, other) => Math.abs(other[1]) - Math.abs(one[1]));
  return [["covers", mark.covers], ...costs.map(([name, value]) => [name, -value])];
}

function colorOf(object, name) {
  let found = "transparent";
  object.traverse((part) => { if (part.material?.name === name) found = `#${part.material.color.getHexString()}`; });
  return found;
}
