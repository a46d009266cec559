// Small parts that several pages use.
import { html, useEffect, useRef, useState } from "./html.js";
import { t } from "./text.js";

const PATHS = {
  upload: "M12 16V4m0 0L7 9m5-5 5 5M4 16v3a1 1 0 0 0 1 1h14a1 1 0 0 0 1-1v-3",
  download: "M12 4v12m0 0 5-5m-5 5-5-5M4 19h16",
  fit: "M4 9V5a1 1 0 0 1 1-1h4m6 0h4a1 1 0 0 1 1 1v4m0 6v4a1 1 0 0 1-1 1h-4m-6 0H5a1 1 0 0 1-1-1v-4",
  key: "M14.5 9.5a4.5 4.5 0 1 1-3.2-4.3A4.5 4.5 0 0 1 14.5 9.5Zm-1.3 3 7.3 7.5m-2.5-2.5 2-2",
  close: "M6 6l12 12M18 6 6 18",
  trash: "M5 7h14M10 7V4.5h4V7m-7.5 0 .8 12.5h9.4L17.5 7",
  side: "M4 5h16v14H4zM12 5v14",
  split: "M4 5h16v14H4zM14 5v14m-3.5-9L8 12l2.5 2m7-4L20 12l-2.5 2",
  single: "M4 5h16v14H4z",
  check: "m5 12.5 4.5 4.5L19 7.5",
  alert: "M12 8v5m0 3v.2M12 3.5 2.8 19.5h18.4L12 3.5Z",
  pick: "M5 4l6.5 15 2-6.5 6.5-2L5 4Z",
  external: "M13 5h6v6m0-6-8.5 8.5M9 6H6a1 1 0 0 0-1 1v11a1 1 0 0 0 1 1h11a1 1 0 0 0 1-1v-3",
  eye: "M2.5 12S6 5.5 12 5.5 21.5 12 21.5 12 18 18.5 12 18.5 2.5 12 2.5 12Zm9.5-2.8a2.8 2.8 0 1 1 0 5.6 2.8 2.8 0 0 1 0-5.6Z",
  copy: "M9 9h10v11H9zM5 15V4h10",
  cube: "M12 3.5 4.5 7.5v9l7.5 4 7.5-4v-9L12 3.5Zm0 8.5 7.5-4.5M12 12 4.5 7.5M12 12v8.5",
};

export const Icon = ({ name }) => html`
  <svg class="icon" viewBox="0 0 24 24" aria-hidden="true"><path d=${PATHS[name]} /></svg>
`;

export const active = (job) => job && ["queued", "running"].includes(job.state);
export const State = ({ state }) => html`<span class=${`state ${state}`}>${t(`state.${state}`)}</span>`;

/** A choice of a few, as radio buttons in a row. */
export const Choice = ({ name, label, value, options, onChange, disabled = () => false }) => html`
  <div class="choice" role="radiogroup" aria-label=${label}>
    ${options.map(
      ([option, text]) => html`
        <label class=${value === option ? "on" : ""}>
          <input type="radio" name=${name} checked=${value === option} disabled=${disabled(option)} onChange=${() => onChange(option)} />
          <span>${text}</span>
        </label>
      `,
    )}
  </div>
`;

/** Tabs with their panel: arrow keys move between them. */
export function Tabs({ tabs, current, onChange, children }) {
  const list = useRef();
  const keys = (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    const at = tabs.findIndex(([name]) => name === current);
    const next = (at + step + tabs.length) % tabs.length;
    onChange(tabs[next][0]);
    list.current.children[next].focus();
  };
  return html`
    <div class="tabs" role="tablist" ref=${list} onKeyDown=${keys}>
      ${tabs.map(
        ([name, text]) => html`
          <button type="button" role="tab" id=${`tab-${name}`} aria-selected=${String(name === current)}
            aria-controls="tab-panel" tabindex=${name === current ? 0 : -1} onClick=${() => onChange(name)}>${text}</button>
        `,
      )}
    </div>
    <div role="tabpanel" id="tab-panel" aria-labelledby=${`tab-${current}`} class="tab-panel">${children}</div>
  `;
}

/** A sentence of the service, with what stands between backticks as code. */
export const Sentence = ({ text }) => text.split("`").map((part, index) => (index % 2 ? html`<code>${part}</code>` : part));

// The service's codes have a page each in the manual.
const Code = ({ problem }) => problem.local
  ? html`<code>${problem.code}</code>`
  : html`<a href=${`/docs/errors/${encodeURIComponent(problem.code)}/`}><code>${problem.code}</code></a>`;

// The service's own words, about this very file; what kind of thing it is stands above them in the page's language.
const Words = ({ detail, remedy, lang }) => html`
  <p lang=${lang}><${Sentence} text=${detail} /></p>
  <p><strong>${t("problem.remedy")}</strong> <span lang=${lang}><${Sentence} text=${remedy} /></span></p>`;

/** An error in sentences: what is wrong, what to do, and the code. */
export function ProblemCard({ problem, children }) {
  const card = useRef();
  useEffect(() => card.current.scrollIntoView({ block: "center" }), [problem]);
  const text = (part) => (problem.local ? t(`problem.${problem.code}.${part}`) : problem[part]);
  return html`
    <section class="problem" role="alert" ref=${card}>
      <h2><${Icon} name="alert" /> ${problem.local ? text("title") : t(`code.${problem.code}`, {}, problem.title)}</h2>
      <${Words} detail=${text("detail")} remedy=${text("remedy")} lang=${problem.local ? null : "en"} />
      <p class="quiet"><${Code} problem=${problem} />${problem.status ? ` · HTTP ${problem.status}` : ""}</p>
      ${children}
    </section>
  `;
}

/** A warning of a report, likewise. */
export const Notice = ({ notice }) => html`
  <section class="notice">
    <h2><${Icon} name="alert" /> ${t(`code.${notice.code}`, {}, t("notice"))}</h2>
    <${Words} detail=${notice.message} remedy=${notice.remedy} lang="en" />
    <p class="quiet"><code>${notice.code}</code></p>
  </section>
`;

/** A place to drop a file on, or to choose one. */
export function DropZone({ onFile, title, text, formats, accept, id, children }) {
  return html`
    <div class="drop">
      <div class="drop-mark"><${Icon} name="cube" /></div>
      <h1>${title}</h1>
      <p>${text}</p>
      <label class="button primary" for=${id}>${t("drop.choose")}</label>
      <input id=${id} class="hidden-input" type="file" accept=${accept}
        onChange=${(event) => event.target.files[0] && onFile(event.target.files[0])} />
      ${children}
      <p class="quiet">${formats}</p>
      <p class="quiet">${t("drop.private")}</p>
    </div>
  `;
}

/** Take a file that is dropped anywhere in the window; true while one hovers. */
export function useDrop(onFile) {
  const [over, setOver] = useState(false);
  const latest = useRef(onFile);
  latest.current = onFile;
  useEffect(() => {
    const carries = (event) => event.dataTransfer?.types.includes("Files");
    const enter = (event) => carries(event) && (event.preventDefault(), setOver(true));
    const leave = (event) => event.relatedTarget || setOver(false);
    const drop = (event) => {
      if (!carries(event)) return;
      event.preventDefault();
      setOver(false);
      if (event.dataTransfer.files[0]) latest.current(event.dataTransfer.files[0]);
    };
    const events = { dragenter: enter, dragover: enter, dragleave: leave, drop };
    for (const [name, listener] of Object.entries(events)) window.addEventListener(name, listener);
    return () => Object.entries(events).forEach(([name, listener]) => window.removeEventListener(name, listener));
  }, []);
  return over;
}

export function Copy({ text }) {
  const [done, setDone] = useState(false);
  const copy = async () => {
    await navigator.clipboard.writeText(text);
    setDone(true);
    setTimeout(() => setDone(false), 1500);
  };
  return html`<button type="button" class="small" onClick=${copy}>
    <${Icon} name=${done ? "check" : "copy"} /> ${t(done ? "copied" : "copy")}
  </button>`;
}

export const Facts = ({ rows }) => html`
  <dl class="facts">${rows.filter(Boolean).map(([name, value]) => html`<div><dt>${name}</dt><dd>${value}</dd></div>`)}</dl>
`;

/** A bar for a share from 0 to 1, with a tick for comparison. */
export const Meter = ({ label, share, text, tick, tickText }) => html`
  <div class="meter">
    <span class="meter-label">${label}</span><strong>${text}</strong>
    <svg viewBox="0 0 100 6" preserveAspectRatio="none" role="img" aria-label=${`${label}: ${text}${tick ? `; ${tickText}` : ""}`}>
      <rect class="meter-ground" width="100" height="6" rx="0" />
      <rect class="meter-bar" width=${Math.max(0, Math.min(1, share)) * 100} height="6" />
      ${tick && html`<rect class="meter-tick" x=${tick * 100 - 0.4} width="0.8" height="6"><title>${tickText}</title></rect>`}
    </svg>
  </div>
`;
