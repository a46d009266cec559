// The view: a canvas with what is drawn over it (marks, slider, buttons).
import { Icon } from "./parts.js";
import { html, useEffect, useRef, useState } from "./html.js";
import { t } from "./text.js";

/** Models `before` and `after` with marks as buttons; `layout` is single, side or split. */
export function Stage({ before, after, marks = [], current, onMark, layout = "single", onLayout, boxes = [], selected = -1, onBox,
  picking = false, onPicked, viewerRef, children }) {
  const host = useRef();
  const viewer = useRef(null);
  const spots = useRef([]);
  const [split, setSplit] = useState(0.5);
  const [ready, setReady] = useState(false);
  const [failed, setFailed] = useState(false);
  const latest = useRef({});
  latest.current = { onBox, onPicked, marks };
  const shown = layout !== "single" && before && after ? layout : "single";

  useEffect(() => {
    let gone = false;
    let settle;
    const moved = () => {
      const view = viewer.current;
      if (!view) return;
      latest.current.marks.forEach((mark, index) => {
        const spot = spots.current[index];
        if (!spot) return;
        const { x, y, seen } = view.project(mark);
        spot.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
        spot.classList.toggle("behind", !seen);
      });
      clearTimeout(settle);
      settle = setTimeout(() => latest.current.marks.forEach((mark, index) => {
        const spot = spots.current[index];
        if (!gone && spot && !spot.classList.contains("behind") && view.isHidden(mark)) spot.classList.add("behind");
      }), 120);
    };
    import("./viewer.js")
      .then(({ Viewer }) => {
        if (gone) return;
        viewer.current = new Viewer(host.current, {
          moved,
          boxes: (...change) => latest.current.onBox?.(...change),
          picked: (part) => latest.current.onPicked?.(part),
        });
        if (viewerRef) viewerRef.current = viewer.current;
        setReady(true);
      })
      .catch(() => setFailed(true));
    return () => {
      gone = true;
      clearTimeout(settle);
      viewer.current?.dispose();
      viewer.current = null;
    };
  }, []);

  useEffect(() => {
    if (!ready) return;
    viewer.current.show("before", before ?? null);
    viewer.current.show("after", after ?? null);
    host.current.dataset.shown = before || after ? [before && "before", after && "after"].filter(Boolean).join(" ") : "nothing";
  }, [ready, before, after]);
  useEffect(() => { if (ready) viewer.current.setLayout(shown); }, [ready, shown]);
  useEffect(() => { if (ready) viewer.current.setSplit(split); }, [ready, split]);
  useEffect(() => { if (ready && before) viewer.current.setBoxes(boxes, selected); }, [ready, before, boxes, selected]);
  useEffect(() => { if (ready) viewer.current.picking = picking; }, [ready, picking]);
  useEffect(() => { if (ready) viewer.current.invalidate(); }, [ready, marks]);

  const go = (index) => {
    viewer.current?.fly(marks[index]);
    onMark?.(index);
  };
  useEffect(() => { if (ready && current >= 0 && marks[current]) viewer.current.fly(marks[current]); }, [ready, current]);

  return html`
    <div class=${`view ${picking ? "picking" : ""}`} role="group" aria-label=${t("view.label")}>
      <div class="canvas" ref=${host}></div>
      ${failed && html`<p class="card">${t("view.failed")}</p>`}
      ${marks.map(
        (mark, index) => html`
          <button type="button" key=${index} class=${`spot ${index === current ? "on" : ""}`} ref=${(e) => (spots.current[index] = e)}
            onClick=${() => go(index)} aria-label=${t("mark.go", { n: index + 1, text: mark.text })}>
            <span>${index + 1}</span>
          </button>
        `,
      )}
      ${shown === "split" && html`<${Divider} split=${split} onSplit=${setSplit} host=${host} />`}
      ${shown !== "single" && html`<span class=${`tag first ${shown}`}>${t("view.before")}</span><span class=${`tag second ${shown}`}>${t("view.after")}</span>`}
      ${shown === "side" && html`<span class="seam"></span>`}
      <div class="tools">
        ${onLayout && before && after && html`
          <div class="tool-group" role="group" aria-label=${t("view.layout")}>
            ${["split", "side", "single"].map((name) => html`
              <button type="button" class="tool" aria-pressed=${String(shown === name)} onClick=${() => onLayout(name)}
                title=${t(`view.${name}`)} aria-label=${t(`view.${name}`)}><${Icon} name=${name} /></button>`)}
          </div>`}
        ${(before || after) && html`
          <button type="button" class="tool" onClick=${() => viewer.current?.fit()} title=${t("view.fit")} aria-label=${t("view.fit")}>
            <${Icon} name="fit" /></button>`}
      </div>
      ${children}
    </div>
  `;
}

function Divider({ split, onSplit, host }) {
  const limit = (value) => Math.min(1, Math.max(0, value));
  const move = (event) => {
    if (!event.currentTarget.hasPointerCapture(event.pointerId)) return;
    const { left, width } = host.current.getBoundingClientRect();
    onSplit(limit((event.clientX - left) / width));
  };
  const keys = (event) => {
    const to = { ArrowLeft: split - 0.05, ArrowRight: split + 0.05, Home: 0, End: 1 }[event.key];
    if (to === undefined) return;
    event.preventDefault();
    onSplit(limit(to));
  };
  return html`
    <div class="divider" role="slider" tabindex="0" aria-label=${t("view.divider")} aria-valuemin="0" aria-valuemax="100"
      aria-valuenow=${Math.round(split * 100)} style=${{ left: `${split * 100}%` }} onKeyDown=${keys}
      onPointerDown=${(event) => event.currentTarget.setPointerCapture(event.pointerId)} onPointerMove=${move}><span></span></div>
  `;
}
