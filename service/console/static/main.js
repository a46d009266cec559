import { html, render } from "./html.js";

render(html`<h1>Meshmark</h1>`, document.getElementById("app"));
