// Files as they are seen: read in this browser; where it cannot, and its user agrees, as a plain GLB that the service makes.
import { Problem, convert } from "./api.js";
import { html, useEffect, useRef, useState } from "./html.js";
import { Icon } from "./parts.js";
import { bytes, length, number, t } from "./text.js";

export const ACCEPT = ".glb,.gltf,.obj,.stl,.ply,.off,.3mf,.dae,.zip";
const CONVERTIBLE = ["notshown.format", "notshown.compressed", "notshown.unreadable"];

// By file: {model} or {notShown}, so that it is read once, whichever pages show it.
const known = new WeakMap();

/** Read a file for showing: {model} or {notShown}. */
export async function look(file) {
  if (known.has(file)) return known.get(file);
  const { NotShown, readModel } = await import("./models.js");
  const seen = {};
  try {
    seen.model = await readModel(file);
  } catch (error) {
    if (!(error instanceof NotShown)) throw error;
    seen.notShown = error;
  }
  known.set(file, seen);
  return seen;
}

/**
 * What is seen of a file: {model, notShown, show, doing, problem, cancel}. `show` is there where the service can help,
 * `doing` ({step, share}) while it does; with `atOnce` it is asked by itself, for a file that it has had already.
 */
export function useSeen(file, atOnce = false) {
  const [seen, setSeen] = useState({});
  const [doing, setDoing] = useState(null);
  const [problem, setProblem] = useState(null);
  const stop = useRef(null);
  useEffect(() => {
    let gone = false;
    setSeen(known.get(file) ?? {});
    setProblem(null);
    if (file && !known.has(file)) look(file).then((result) => gone || setSeen(result));
    return () => {
      gone = true;
      stop.current?.abort();
    };
  }, [file]);

  const show = async () => {
    const { signal } = (stop.current = new AbortController());
    const tell = (step) => signal.aborted || setDoing(step);
    tell({ step: "sending", share: 0 });
    setProblem(null);
    try {
      const glb = await convert(file, tell, signal);
      const converted = await look(new File([glb], "converted.glb"));
      if (converted.model) known.set(file, converted);
      if (!signal.aborted) setSeen(converted);
    } catch (error) {
      if (signal.aborted) return;
      if (!(error instanceof Problem)) throw error;
      setProblem(error);
    } finally {
      if (stop.current.signal === signal) setDoing(null);
    }
  };
  const helps = Boolean(file && CONVERTIBLE.includes(seen.notShown?.key));
  useEffect(() => { if (helps && atOnce) show(); }, [helps, atOnce, file]);
  return { ...seen, show: helps ? show : null, doing, problem, cancel: () => stop.current?.abort() };
}

/** In the place of a model that is not shown: why, and the way to see it all the same. */
export const NotShownCard = ({ seen, children }) => html`
  <div class="card">
    <${Icon} name="cube" />
    <p>${t(seen.notShown.key, seen.notShown.values)}</p>
    ${seen.show && (!seen.doing
      ? html`<button type="button" onClick=${seen.show}><${Icon} name="eye" /> ${t("notshown.show")}</button><p class="hint">${t("notshown.sent")}</p>`
      : html`<div class="progress" role="status"><progress max="1" value=${seen.doing.share} aria-label=${t("notshown.reading")}></progress>
          <span>${t(seen.doing.step)}</span><button type="button" class="small" onClick=${seen.cancel}>${t("cancel")}</button></div>`)}
    ${children}
  </div>`;

export function fileFacts(file, facts) {
  return [
    [t("fact.size"), bytes(file.size)],
    facts && [t("fact.faces"), number(facts.faces)],
    facts && [t("fact.materials"), number(facts.materials)],
    facts && [t("fact.textures"), number(facts.textures)],
    facts?.size && [t("fact.extent"), facts.size.map(length).join(" × ")],
  ];
}
