// The copies of a job: a text for each buyer, at the places of its marks.
import { request, save } from "./api.js";
import { html, useState } from "./html.js";
import { usePages } from "./pages.js";
import { Icon, ProblemCard, State } from "./parts.js";
import { t } from "./text.js";

const PAUSE = 3000; // milliseconds between two looks while something runs

export function CopiesTab({ job, stem }) {
  const path = `${job.links.self}/copies`;
  const [texts, setTexts] = useState("");
  const { items, more, again, ...list } = usePages(`${path}?limit=100`, PAUSE);
  const [refused, setRefused] = useState(null);
  const problem = refused ?? list.problem;
  const wanted = texts.split("\n").map((line) => line.trim()).filter(Boolean);

  const tried = (work) => async (event) => {
    event.preventDefault();
    setRefused(null);
    try {
      await work();
    } catch (error) {
      setRefused(error);
    }
  };
  const make = tried(async () => {
    const body = JSON.stringify({ copies: wanted.map((text) => ({ text })) });
    await request(path, { method: "POST", headers: { "Content-Type": "application/json" }, body });
    setTexts("");
    again();
  });

  return html`
    <form class="copies" onSubmit=${make}>
      <label for="copies">${t("copies.texts")}</label>
      <textarea id="copies" rows="3" value=${texts} aria-describedby="copies-hint" onInput=${(event) => setTexts(event.target.value)}></textarea>
      <p class="hint" id="copies-hint">${t("copies.hint")}</p>
      <button type="submit" class="primary" disabled=${!wanted.length}>${t(wanted.length ? "copies.make" : "copies.make.none", { n: wanted.length })}</button>
    </form>
    ${problem && html`<${ProblemCard} problem=${problem} />`}
    ${!problem && !items && html`<p class="quiet" role="status">${t("loading")}</p>`}
    ${items?.length === 0 && html`<p class="quiet">${t("copies.none")}</p>`}
    <ul class="copies">
      ${items?.map((copy) => html`
        <li key=${copy.id}>
          <a href=${`#/jobs/${copy.id}`}>${copy.text ?? t("jobs.deleted")}</a>
          <${State} state=${copy.state} />
          ${copy.links.model && html`
            <button type="button" class="small" aria-label=${t("copies.download", { text: copy.text })} onClick=${tried(() => save(copy.links.model, `${stem}-${nameOf(copy.text)}.watermarked.glb`))}>
              <${Icon} name="download" /></button>`}
          ${copy.error && html`<p class="hint" lang="en">${copy.error.detail} ${copy.error.remedy}</p>`}
        </li>`)}
    </ul>
    ${more && html`<button type="button" onClick=${more}>${t("jobs.more")}</button>`}`;
}

const nameOf = (text) => text.replace(/[^\p{L}\p{N}._-]+/gu, "-").slice(0, 60);
