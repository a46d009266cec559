"use strict";
// Asks the questions of a study, one asset after the other in an order of its own, which of the two is A and which B
// being drawn anew for each; answers are kept in this browser until they are saved as a file.

const { study, level, questions, trials } = JSON.parse(document.getElementById("content").textContent);
const main = document.getElementById("study");
const store = `meshmark-study-${study}`;

function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (value !== false) made.setAttribute(key, value === true ? "" : value);
  }
  made.append(...children);
  return made;
}

function randomHex(length) {
  const bytes = crypto.getRandomValues(new Uint8Array(length / 2));
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
}

function shuffled(items) {
  const mixed = [...items];
  for (let last = mixed.length - 1; last > 0; last -= 1) {
    const other = crypto.getRandomValues(new Uint32Array(1))[0] % (last + 1);
    [mixed[last], mixed[other]] = [mixed[other], mixed[last]];
  }
  return mixed;
}

function begin() {
  return {
    participant: randomHex(12),
    order: shuffled(trials.map((_, number) => number)),
    turned: trials.map(() => crypto.getRandomValues(new Uint8Array(1))[0] < 128),
    done: 0,
    answers: [],
  };
}

function restored() {
  try {
    const kept = JSON.parse(localStorage.getItem(store));
    return kept && kept.order.length === trials.length ? kept : begin();
  } catch {
    return begin(); // nothing was kept, or this browser keeps nothing
  }
}

const state = restored();

function keep() {
  try {
    localStorage.setItem(store, JSON.stringify(state));
  } catch {
    // Without a store the answers last as long as the page.
  }
}

function sidesOf(number) {
  return state.turned[number] ? ["second", "first"] : ["first", "second"];
}

function views(trial, sides) {
  const shown = [["Without watermarks", trial.original], ["A", trial[sides[0]]], ["B", trial[sides[1]]]];
  const pictures = shown.map(([name]) => element("img", { alt: `The asset: ${name}`, draggable: "false" }));
  const count = trial.original.length;
  const slider = element("input", {
    type: "range", min: 0, max: count - 1, value: 0, "aria-label": "Turn the asset", oninput: show,
  });
  function show() {
    const view = Number(slider.value);
    pictures.forEach((picture, place) => { picture.src = shown[place][1][view]; });
    slider.setAttribute("aria-valuetext", `view ${view + 1} of ${count}${view >= level ? ", from above" : ""}`);
  }
  function drag(event) {
    event.preventDefault();
    const from = event.clientX;
    const start = Number(slider.value);
    function move(at) {
      const steps = Math.round((from - at.clientX) / 24);
      const round = start < level ? [0, level] : [level, count - level];
      slider.value = round[0] + ((((start - round[0] + steps) % round[1]) + round[1]) % round[1]);
      show();
    }
    function end() {
      removeEventListener("pointermove", move);
      removeEventListener("pointerup", end);
      removeEventListener("pointercancel", end);
    }
    addEventListener("pointermove", move);
    addEventListener("pointerup", end);
    addEventListener("pointercancel", end);
  }
  pictures.forEach((picture) => picture.addEventListener("pointerdown", drag));
  show();
  return [
    element("div", { class: "views" }, ...shown.map(([name], place) =>
      element("figure", {}, pictures[place], element("figcaption", {}, name)))),
    element("div", { class: "turn" }, element("span", { class: "soft" }, "around"), slider,
      element("span", { class: "soft" }, "from above")),
  ];
}

function ask() {
  const number = state.order[state.done];
  const trial = trials[number];
  const sides = sidesOf(number);
  const names = Object.keys(questions);
  const next = element("button", { type: "submit", disabled: true }, "Next");
  function choice(question, place, word) {
    const name = `${question}-${sides[place]}`;
    return element("label", {}, element("input", {
      type: "radio", name, value: word, "aria-label": `${questions[question]} ${"AB"[place]}: ${word}`,
    }), word);
  }
  const form = element("form", {
    onchange: () => { next.disabled = [...new FormData(form)].length < 2 * names.length; },
    onsubmit: (event) => {
      event.preventDefault();
      for (const [name, value] of new FormData(form)) {
        const [question, side] = name.split("-");
        state.answers.push({ trial: trial.id, side, question, yes: value === "yes" });
      }
      state.done += 1;
      keep();
      draw();
    },
  }, element("table", {},
    element("thead", {}, element("tr", {}, element("th", { scope: "col" }, "Yes or no?"),
      element("th", { scope: "col" }, "A"), element("th", { scope: "col" }, "B"))),
    element("tbody", {}, ...names.map((question) => element("tr", {},
      element("th", { scope: "row" }, questions[question]),
      ...[0, 1].map((place) => element("td", { "data-side": "AB"[place] },
        choice(question, place, "yes"), choice(question, place, "no"))))))), next);
  return [
    element("h1", { tabindex: "-1" }, `Asset ${state.done + 1} of ${trials.length}`),
    element("progress", { max: trials.length, value: state.done, "aria-label": "Assets answered" }),
    element("p", { class: "soft" }, "A and B carry watermarks, made in two ways. Turn the asset with the slider or by "
      + "dragging a picture; answer for A and for B. There are no right answers."),
    ...views(trial, sides), form,
  ];
}

function thank() {
  const saved = {
    schema: "meshmark.study-answers/1", study, participant: state.participant, answers: state.answers,
  };
  const file = new Blob([JSON.stringify(saved, null, 1)], { type: "application/json" });
  return [
    element("h1", { tabindex: "-1" }, "Thank you"),
    element("p", {}, "Your answers are still in this browser only. Save them, and send the file to whoever asked you."),
    element("p", {}, element("a", {
      class: "save", href: URL.createObjectURL(file), download: `answers-${state.participant}.json`,
    }, "Save your answers")),
    element("p", {}, element("button", {
      type: "button",
      onclick: () => { Object.assign(state, begin()); keep(); draw(); },
    }, "Start again, as somebody else")),
  ];
}

function draw() {
  main.replaceChildren(...(state.done < trials.length ? ask() : thank()));
  main.querySelector("h1").focus({ preventScroll: true });
  scrollTo(0, 0);
}

draw();
