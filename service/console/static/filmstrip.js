// The paper's views as small pictures, each with how far the text is read there.
import { html, useEffect, useState } from "./html.js";
import { percent, t } from "./text.js";

export function Filmstrip({ views, object, viewer }) {
  const [pictures, setPictures] = useState([]);
  useEffect(() => {
    if (!object || !viewer.current) return;
    let gone = false;
    let made = [];
    viewer.current.pictures(views).then((blobs) => {
      if (gone) return;
      made = blobs.map((blob) => URL.createObjectURL(blob));
      setPictures(made);
    });
    return () => {
      gone = true;
      made.forEach((url) => URL.revokeObjectURL(url));
    };
  }, [views, object]);
  return html`
    <h2>${t("views.title")}</h2>
    <ol class="filmstrip">
      ${views.map((view, index) => html`
        <li><button type="button" onClick=${() => viewer.current?.lookFrom(view.direction)} aria-label=${t("views.one", { n: index + 1, share: percent(view.ocr) })}>
          <img src=${pictures[index]} alt="" /><span>${percent(view.ocr)}</span></button></li>`)}
    </ol>
    <p class="hint">${t("views.hint")}</p>`;
}
