// All jobs, newest first.
import { html, useEffect, useRef, useState } from "./html.js";
import { usePicture } from "./job-page.js";
import { usePages } from "./pages.js";
import { Choice, Icon, ProblemCard, State } from "./parts.js";
import { moment, t } from "./text.js";

const STATES = ["all", "running", "queued", "succeeded", "failed", "canceled", "expired"];
const KINDS = { watermarks: "jobs", verifications: "verifications" };
const PAUSE = 5000; // milliseconds between two looks while something runs

function Thumbnail({ path }) {
  const box = useRef();
  const [near, setNear] = useState(false);
  useEffect(() => {
    const observer = new IntersectionObserver(([entry]) => entry.isIntersecting && setNear(true), { rootMargin: "200px" });
    observer.observe(box.current);
    return () => observer.disconnect();
  }, []);
  const url = usePicture(near ? path : null);
  return html`<span class="thumbnail" ref=${box}>${url ? html`<img src=${url} alt="" />` : html`<${Icon} name="cube" />`}</span>`;
}

export function JobsPage() {
  const [kind, setKind] = useState("watermarks");
  const [state, setState] = useState("all");
  const { items, problem, more } = usePages(`/v1/${kind}${state === "all" ? "" : `?state=${state}`}`, PAUSE);

  return html`
    <main class="list" id="main" tabindex="-1">
      <div class="row spread wrap">
        <h1>${t("jobs.title")}</h1>
        <${Choice} name="kind" label=${t("jobs.kind")} value=${kind} options=${Object.keys(KINDS).map((name) => [name, t(`jobs.${name}`)])} onChange=${setKind} />
      </div>
      <div class="chips" role="group" aria-label=${t("jobs.filter")}>
        ${STATES.map((name) => html`<button type="button" class="chip" aria-pressed=${String(name === state)} onClick=${() => setState(name)}>${t(`state.${name}`)}</button>`)}
      </div>
      ${problem && html`<${ProblemCard} problem=${problem} />`}
      ${!problem && !items && html`<p class="quiet" role="status">${t("loading")}</p>`}
      ${items?.length === 0 && html`<div class="empty"><${Icon} name="cube" /><p>${t("jobs.none")}</p><a class="button primary" href="#/">${t("jobs.first")}</a></div>`}
      <ul class="jobs">
        ${items?.map((job) => html`
          <li key=${job.id}><a href=${`#/${KINDS[kind]}/${job.id}`}>
            <${Thumbnail} path=${job.links.preview ?? null} />
            <span class="job-name"><strong>${job.input?.filename ?? t("jobs.deleted")}</strong>
              <span class="quiet">${(kind === "watermarks" ? job.parameters?.text : job.texts?.join(", ")) || " "}</span></span>
            <span class="quiet job-time">${moment(job.created_at)}</span>
            <${State} state=${job.state} />
          </a></li>`)}
      </ul>
      ${more && html`<button type="button" onClick=${more}>${t("jobs.more")}</button>`}
    </main>`;
}
