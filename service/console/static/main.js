// The page: head, navigation by the address after #, the dialog for a key.
import { key, onKeyNeeded, setKey } from "./api.js";
import { html, render, useEffect, useRef, useState } from "./html.js";
import { JobPage } from "./job-page.js";
import { JobsPage } from "./jobs-page.js";
import { Icon } from "./parts.js";
import { chooseLanguage, currentLanguage, t, useLanguage } from "./text.js";
import { VerificationPage, VerifyPage } from "./verify-page.js";
import { WatermarkPage } from "./watermark-page.js";

const ROUTES = [
  [/^#\/jobs\/([^/]+)$/, JobPage, "jobs"],
  [/^#\/jobs$/, JobsPage, "jobs"],
  [/^#\/verifications\/([^/]+)$/, VerificationPage, "verify"],
  [/^#\/verify$/, VerifyPage, "verify"],
  [/^/, WatermarkPage, "watermark"],
];
const LINKS = { watermark: "#/", verify: "#/verify", jobs: "#/jobs" };

const go = (hash) => (location.hash = hash);

function KeyDialog({ asked, onDone }) {
  const dialog = useRef();
  const input = useRef();
  useEffect(() => {
    if (asked && !dialog.current.open) {
      input.current.value = key();
      dialog.current.showModal();
    }
  }, [asked]);
  const done = (value) => {
    if (value !== null) setKey(value);
    dialog.current.close();
    onDone(value);
  };
  return html`
    <dialog ref=${dialog} aria-labelledby="key-title" onCancel=${(event) => (event.preventDefault(), done(null))}>
      <form method="dialog" onSubmit=${(event) => (event.preventDefault(), done(input.current.value.trim()))}>
        <h2 id="key-title">${t("key.title")}</h2>
        <p>${t(`key.${asked ?? "offered"}`)}</p>
        <div class="field"><label for="key">${t("key.label")}</label>
          <input id="key" ref=${input} type="password" autocomplete="off" spellcheck="false" placeholder="mm_…" />
          <p class="hint">${t("key.hint")}</p></div>
        <div class="row end">
          ${key() && html`<button type="button" onClick=${() => done("")}>${t("key.forget")}</button>`}
          <button type="button" onClick=${() => done(null)}>${t("cancel")}</button>
          <button type="submit" class="primary">${t("key.use")}</button>
        </div>
      </form>
    </dialog>`;
}

function App() {
  const language = useLanguage();
  const [hash, setHash] = useState(location.hash);
  const [asked, ask] = useState(null);
  const waiting = useRef([]);
  const moved = useRef(false);
  useEffect(() => {
    // A file that is dropped beside its place shall not take the page's.
    for (const type of ["dragover", "drop"]) window.addEventListener(type, (event) => event.preventDefault());
    const changed = () => {
      setHash(location.hash);
      window.scrollTo(0, 0);
      moved.current = true;
    };
    window.addEventListener("hashchange", changed);
    onKeyNeeded(() => new Promise((answer) => {
      waiting.current.push(answer);
      ask(key() ? "refused" : "needed");
    }));
    return () => window.removeEventListener("hashchange", changed);
  }, []);
  const answered = (value) => {
    ask(null);
    waiting.current.splice(0).forEach((answer) => answer(Boolean(value)));
  };
  const [match, Page, section] = ROUTES.map(([pattern, ...rest]) => [hash.match(pattern), ...rest]).find(([found]) => found);
  const id = match[1] && decodeURIComponent(match[1]);
  useEffect(() => { if (moved.current) document.getElementById("main").focus({ preventScroll: true }); }, [hash]);
  useEffect(() => { document.title = `${t(`nav.${section}`)} · Meshmark`; }, [section, language]);
  return html`
    <a class="skip" href="#main" onClick=${(event) => { event.preventDefault(); document.getElementById("main").focus(); }}>${t("skip")}</a>
    <header>
      <a class="brand" href="#/" aria-label="Meshmark">
        <svg viewBox="0 0 32 32" aria-hidden="true"><rect width="32" height="32" rx="8" /><path d="M16 5.5 25.5 11v10L16 26.5 6.5 21V11Z" /><path d="M11 19.5v-6l5 4.5 5-4.5v6" /></svg>
        <span>Meshmark</span></a>
      <nav aria-label=${t("nav.label")}>
        ${Object.entries(LINKS).map(([name, link]) => html`<a href=${link} aria-current=${name === section ? "page" : null}>${t(`nav.${name}`)}</a>`)}
      </nav>
      <div class="head-end">
        <a class="docs" href="/docs/">${t("nav.docs")}</a>
        <button type="button" class="plain" lang=${language === "en" ? "zh-Hans" : "en"} onClick=${() => chooseLanguage(currentLanguage() === "en" ? "zh" : "en")}>${language === "en" ? "中文" : "English"}</button>
        <button type="button" class=${`tool plain ${key() ? "on" : ""}`} onClick=${() => ask("offered")} title=${t("key.title")} aria-label=${t("key.title")}><${Icon} name="key" /></button>
      </div>
    </header>
    <${Page} key=${`${section}/${id ?? ""}`} id=${id} go=${go} />
    <${KeyDialog} asked=${asked} onDone=${answered} />`;
}

render(html`<${App} />`, document.getElementById("app"));
