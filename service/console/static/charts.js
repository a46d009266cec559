// Drawings of figures, as SVG.
import { html, useMemo } from "./html.js";
import { t } from "./text.js";

const [COLUMNS, ROWS] = [72, 24];
const FACING = Math.cos(Math.PI / 4);

/** Directions from which a mark is faced within 45 degrees: the sphere in equal areas, the front in the middle. */
export function SphereMap({ marks, current, onMark }) {
  const paths = useMemo(() => {
    const levels = ["", "", "", ""];
    for (let row = 0; row < ROWS; row++)
      for (let column = 0; column < COLUMNS; column++) {
        const y = 1 - ((row + 0.5) / ROWS) * 2;
        const round = Math.sqrt(1 - y * y);
        const angle = ((column + 0.5) / COLUMNS - 0.5) * 2 * Math.PI;
        const direction = [Math.sin(angle) * round, y, Math.cos(angle) * round];
        const facing = marks.filter(({ normal }) => normal.reduce((sum, v, k) => sum + v * direction[k], 0) > FACING).length;
        levels[Math.min(facing, 3)] += `M${column} ${row}h1v1h-1z`;
      }
    return levels;
  }, [marks]);
  const place = ({ normal: [x, y, z] }) => [((Math.atan2(x, z) / (2 * Math.PI)) + 0.5) * COLUMNS, ((1 - y) / 2) * ROWS];
  return html`
    <figure class="sphere">
      <svg viewBox="0 0 72 24" shape-rendering="geometricPrecision" role="img" aria-label=${t("sphere.label", { n: marks.length })}>
        ${paths.map((d, level) => d && html`<path class=${`level-${level}`} d=${d} />`)}
        ${marks.map((mark, index) => {
          const [x, y] = place(mark);
          return html`<circle class=${index === current ? "on" : ""} cx=${x} cy=${y} r=${index === current ? 1.5 : 0.9} onClick=${() => onMark(index)}>
            <title>${index + 1}</title></circle>`;
        })}
      </svg>
      <div class="sphere-axis" aria-hidden="true">${["back", "left", "front", "right", "back"].map((side) => html`<span>${t(`side.${side}`)}</span>`)}</div>
      <figcaption class="hint">${t("sphere.hint")}</figcaption>
    </figure>`;
}
