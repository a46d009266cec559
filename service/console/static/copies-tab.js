// The copies of a job: a text for each buyer, at the places of its marks.
import { getJson, request, save } from "./api.js";
import { html, useEffect, useState } from "./html.js";
import { Icon, ProblemCard, State, active } from "./parts.js";
import { t } from "./text.js";

const PAUSE = 3000; // milliseconds between two looks while something runs

export function CopiesTab({ job, stem }) {
  const path = `${job.links.self}/copies`;
  const [texts, setTexts] = useState("");
  const [items, setItems] = useState(null);
  const [next, setNext] = useState(null);
  const [asked, setAsked] = useState(0);
  const [problem, setProblem] = useState(null);
  const wanted = texts.split("\n").map((line) => line.trim()).filter(Boolean);

  useEffect(() => {
    let gone = false;
    let timer;
    const load = async () => {
      try {
        const page = await getJson(`${path}?limit=100`);
        if (gone) return;
        setItems(page.items);
        setNext(page.next);
        if (page.items.some(active)) timer = setTimeout(load, PAUSE);
      } catch (error) {
        if (!gone) setProblem(error);
      }
    };
    load();
    return () => {
      gone = true;
      clearTimeout(timer);
    };
  }, [path, asked]);

  const tried = (work) => async (event) => {
    event.preventDefault();
    setProblem(null);
    try {
      await work();
    } catch (error) {
      setProblem(error);
    }
  };
  const make = tried(async () => {
    const body = JSON.stringify({ copies: wanted.map((text) => ({ text })) });
    await request(path, { method: "POST", headers: { "Content-Type": "application/json" }, body });
    setTexts("");
    setAsked(asked + 1);
  });
  const more = tried(async () => {
    const page = await getJson(next);
    setItems([...items, ...page.items]);
    setNext(page.next);
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
    ${next && html`<button type="button" onClick=${more}>${t("jobs.more")}</button>`}`;
}

const nameOf = (text) => text.replace(/[^\p{L}\p{N}._-]+/gu, "-").slice(0, 60);
