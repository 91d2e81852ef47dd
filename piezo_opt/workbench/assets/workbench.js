"use strict";
// What comes from a file (names, headers, sentences) becomes text nodes only, never markup.

const $ = (id) => document.getElementById(id);

function el(tag, about, ...children) {
  const made = document.createElement(tag);
  for (const [key, value] of Object.entries(about || {})) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (key in made && key !== "list") made[key] = value;
    else made.setAttribute(key, value);
  }
  made.append(...children.map((c) => (typeof c === "string" ? document.createTextNode(c) : c)));
  return made;
}

const fill = (where, ...children) => where.replaceChildren(...children);

// ---------------------------------------------------------------- numbers and units

const PREFIX = { "-15": "f", "-12": "p", "-9": "n", "-6": "µ", "-3": "m", 0: "", 3: "k", 6: "M" };

function prefixed(unit, largest) {
  // A factor and a unit that bring the largest number between 1 and 1000.
  if (!/^[mVN]/.test(unit) || !(largest > 0)) return [1, unit];
  let exponent = 3 * Math.floor(Math.log10(largest) / 3 + 1e-9);
  exponent = Math.min(Math.max(exponent, -15), unit[0] === "m" ? 0 : 6);
  if (unit[0] === "V" && largest >= 0.1 && largest < 1000) exponent = 0;
  return [10 ** -exponent, PREFIX[exponent] + unit];
}

function show(value, unit) {
  if (value === null || value === undefined) return "unknown";
  const [factor, name] = prefixed(unit, Math.abs(value));
  return digits(value * factor) + (name === "1" ? "" : " " + name);
}

// "um" as engineers write it.
const said = (text) => text.replace(/(\d )um\b/g, "$1µm");

const largest = (...lists) => {
  let most = 0;
  for (const list of lists) for (const x of list || []) if (x !== null && Math.abs(x) > most) most = Math.abs(x);
  return most;
};

const scaled = (list, factor) => list.map((x) => (x === null ? null : x * factor));

// ---------------------------------------------------------------- what is known

let state = null;
let view = null; // pictures of the stretch that is looked at
let placed = null; // and of where the residual lives
let known = ""; // what the curves that are shown follow from
let span = null; // [begin, end] of that stretch, or null for the whole
let suspect = ""; // whose curve lies over the residual
let record = 0;
let live = []; // iterates of the step that is being solved
let plots = {};
let asked = 0;
let marks = []; // stretches of time that were brushed in the plane

const SILENT = "The server does not answer: start it again with --session; every step is in its file.";

async function ask(path, options) {
  // What the server answers, or null: then the reason is told.
  let sentence = SILENT;
  try {
    const answer = await fetch(path, options);
    if (answer.ok) return await answer.json();
    sentence = (await answer.json()).sentence;
  } catch (error) { /* there is no server, or it ended within its answer */ }
  problem(sentence);
  return null;
}

async function post(body) {
  const options = { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify({ version: state.version, ...body }) };
  if (await ask("do", options)) problem("");
}

async function takeAway(link) {
  // A file that could not be made is a sentence on the page, not a failed download.
  try {
    const answer = await fetch(link.href);
    if (!answer.ok) { problem((await answer.json()).sentence); return; }
    const [, name] = /filename="([^"]+)"/.exec(answer.headers.get("content-disposition"));
    const url = URL.createObjectURL(await answer.blob());
    el("a", { href: url, download: name }).click();
    setTimeout(() => URL.revokeObjectURL(url), 60000);
  } catch (error) { problem(SILENT); }
}

function problem(sentence) {
  $("problem").hidden = !sentence;
  $("problem").textContent = sentence;
}

// ---------------------------------------------------------------- curves

const whole = () => state.records.records[record].span;

function put(key, panel, about, ends) {
  // A panel in its place: new numbers where it looks as before, another plot where it does not.
  if (plots[key] && plots[key].likeness === likeness(panel)) { plots[key].renew(panel, ends); return; }
  if (plots[key]) plots[key].destroy();
  plots[key] = drawn($(key), panel, about);
  if (ends) plots[key].renew(panel, ends);
}

function build() {
  for (const plot of Object.values(plots)) plot.destroy();
  plots = {};
  draw();
  drawPlace();
}

function draw() {
  if (!view || !state.records) return;
  const [above, below] = view.time.panels, factor = above.across.factor;
  const ends = (span || whole()).map((t) => t * factor);
  const overTime = {
    sync: "time", onSelect: (picked) => look(picked && picked.map((t) => t / factor)),
    marks: () => marks.map((pair) => pair.map((t) => t * factor)),
  };
  put("overlay", above, overTime, ends);
  $("residual-part").hidden = !below.traces.length;
  if (below.traces.length) put("residual", below, overTime, ends);
  const fresh = plots.plane;
  put("plane", { ...view.plane.panels[0], title: "" }, {});
  if (plots.plane !== fresh) brushable(plots.plane.plot);
  $("shown").textContent = suspect && below.traces.length > 1 ? `and what ${suspect} would explain of it` : "";
  $("span").textContent = span ? `${digits(span[0])} s to ${digits(span[1])} s, ${view.samples} samples` : `${view.samples} samples`;
  drawError();
}

function brushable(u) {
  // A rectangle in the plane: when the record was inside it is shaded over time.
  const over = u.over, box = el("div", { className: "u-select" });
  let from = null;
  const at = (event) => {
    const area = over.getBoundingClientRect();
    return [Math.min(Math.max(event.clientX - area.left, 0), area.width), Math.min(Math.max(event.clientY - area.top, 0), area.height)];
  };
  const corners = (to) => [Math.min(from[0], to[0]), Math.max(from[0], to[0]), Math.min(from[1], to[1]), Math.max(from[1], to[1])];
  over.append(box);
  over.addEventListener("pointerdown", (event) => { from = at(event); over.setPointerCapture(event.pointerId); });
  over.addEventListener("pointermove", (event) => {
    if (!from) return;
    const [left, right, top, bottom] = corners(at(event));
    Object.assign(box.style, { left: `${left}px`, top: `${top}px`, width: `${right - left}px`, height: `${bottom - top}px` });
  });
  over.addEventListener("pointerup", (event) => {
    if (!from) return;
    const [left, right, top, bottom] = corners(at(event));
    from = null;
    if (right - left < 4 || bottom - top < 4) brush(null);
    else inside(left, right, top, bottom);
  });
  const inside = (left, right, top, bottom) => {
    const panel = view.plane.panels[0], [drive, position] = [panel.across.factor, panel.up.factor];
    brush({ left: u.posToVal(left, "x") / drive, right: u.posToVal(right, "x") / drive,
      low: u.posToVal(bottom, "y") / position, high: u.posToVal(top, "y") / position });
  };
  // The same by keys: arrows move it, with Shift they move its lower right corner.
  let [left, right, top, bottom] = [0.5, 1, 0, 1];
  over.tabIndex = 0;
  over.setAttribute("role", "application");
  over.setAttribute("aria-label", "Rectangle in the loop: Enter draws it, arrows move it, with Shift they size it, Delete removes it");
  over.addEventListener("keydown", (event) => {
    const [dx, dy] = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1], Enter: [0, 0] }[event.key] || [];
    if (event.key === "Delete") brush(null);
    if (dx === undefined) return;
    event.preventDefault(); event.stopPropagation();
    const within = (x, low, high) => Math.min(Math.max(x, low), high);
    if (!event.shiftKey) {
      const [x, y] = [within(dx, -left, 1 - right), within(dy, -top, 1 - bottom)];
      [left, right, top, bottom] = [left + x, right + x, top + y, bottom + y];
    } else [right, bottom] = [within(right + dx, left + 0.05, 1), within(bottom + dy, top + 0.05, 1)];
    const { clientWidth: wide, clientHeight: high } = over;
    Object.assign(box.style, { left: `${left * wide}px`, top: `${top * high}px`, width: `${(right - left) * wide}px`, height: `${(bottom - top) * high}px` });
    inside(left * wide, right * wide, top * high, bottom * high);
  });
}

async function brush(rectangle) {
  let told = { stretches: [], samples: 0 };
  if (rectangle) {
    told = await ask("brushed?" + new URLSearchParams({ record, ...rectangle }));
    if (!told) return;
  } else for (const box of document.querySelectorAll("#plane .u-select")) Object.assign(box.style, { width: "0", height: "0" });
  marks = told.stretches;
  $("brushed").textContent = rectangle ? `${told.samples} samples inside` : "";
  for (const key of ["overlay", "residual"]) if (plots[key]) plots[key].redraw();
}

function drawError() {
  if (!view) return;
  // The errors of every iterate of the steps that hold, and of the one that is being solved.
  $("error-part").hidden = !state.steps.length;
  if (!state.steps.length) return;
  const rms = [], ends = [];
  const last = state.solving >= 0 ? state.solving - 1 : state.depth;
  state.steps.slice(0, last + 1).forEach((step) => {
    step.trace.forEach((value, k) => { rms.push(value); ends.push(k === step.trace.length - 1 ? value : null); });
  });
  live.forEach((value) => { rms.push(value); ends.push(null); });
  const [factor, unit] = prefixed(state.records.records[record].units.position, largest(rms));
  put("error", {
    title: "", across: { label: "iterate" }, up: { label: `rms error [${unit}]`, logarithmic: true }, x: rms.map((_, k) => k + 1),
    traces: [{ label: "rms", y: scaled(rms, factor), tone: "vermillion", style: "line" },
      { label: "step", y: scaled(ends, factor), tone: "blue", style: "cloud" }],
  }, { across: { incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000] } });
}

async function place() {
  // Where the residual lives: asked for again whenever another fit or record is shown.
  $("place-part").hidden = !state || !state.where;
  if ($("place-part").hidden) return;
  const told = await ask("place?" + new URLSearchParams({ record, by: $("by").value }));
  if (!told) return;
  placed = told;
  for (const option of $("by").options) option.disabled = !placed.views.includes(option.value);
  drawPlace();
}

function drawPlace() {
  $("place-part").hidden = !state || !state.where;
  if ($("place-part").hidden || !placed) return;
  const where = $("place"), count = placed.panels.length;
  if (plots.place) plots.place.destroy();
  where.classList.toggle("beside", placed.beside);
  where.style.height = placed.beside || count === 1 ? "" : `calc(${count} * max(190px, 26vh))`;
  const parts = placed.panels.map(() => el("div", {}));
  fill(where, ...parts);
  const height = (placed.beside ? where.clientHeight : where.clientHeight / count) - 24;
  const made = placed.panels.map((panel, k) => drawn(parts[k], panel, { height }));
  plots.place = { destroy() { made.forEach((one) => one.destroy()); fill(where); } };
}

async function look(ends) {
  if (!state || !state.records) return;
  if (ends === null && marks.length) brush(null);
  if (ends !== undefined) {
    const all = whole();
    span = ends && [Math.max(ends[0], all[0]), Math.min(ends[1], all[1])];
    if (span && !(span[1] > span[0])) span = null;
  }
  const mine = ++asked;
  const query = new URLSearchParams({ record });
  if (span) { query.set("begin", span[0]); query.set("end", span[1]); }
  if (suspect) query.set("suspect", suspect);
  // Of each column of dots its lowest and its highest; more would only take longer to draw.
  query.set("points", Math.round(2 * devicePixelRatio * $("overlay").clientWidth));
  const told = await ask("view?" + query);
  if (!told || mine !== asked) return; // a later one is on its way
  view = told;
  draw();
}

function move(shift, zoom) {
  if (!state || !state.records) return;
  const all = whole();
  const [a, b] = span || all, middle = (a + b) / 2 + shift * (b - a), half = ((b - a) / 2) * zoom;
  if (2 * half >= all[1] - all[0]) { look(null); return; }
  const begin = Math.min(Math.max(middle - half, all[0]), all[1] - 2 * half);
  look([begin, begin + 2 * half]);
}

// ---------------------------------------------------------------- words

function overlay(name) {
  if (suspect === name) return;
  suspect = name;
  for (const row of $("suspects").children) row.classList.toggle("shown", row.dataset.name === name);
  look();
}

function recordsPart() {
  const told = state.records;
  fill($("records"), ...(told ? told.records.map((r) => el("div", {},
    el("table", {}, el("tbody", {},
      el("tr", {}, el("th", { colSpan: 2 }, r.name)),
      ...[["samples", String(r.samples)], ["not counted", r["not counted"] ? String(r["not counted"]) : ""], ["duration", r.duration], ["sampling", r.sampling],
        ["between samples", r.between], ["period", r.period],
        ...Object.entries(r.ranges)].filter(([, v]) => v).map(([k, v]) => el("tr", {}, el("td", {}, k), el("td", {}, said(v)))))),
    r.remarks.length ? el("details", { open: !state.steps.length }, el("summary", {}, r.remarks.length === 1 ? "One remark" : `${r.remarks.length} remarks`),
      el("ul", { className: "remarks" }, ...r.remarks.map((s) => el("li", {}, said(s))))) : "")) : []));
  const open = told ? told.findings.filter((f) => f.answer === "refused") : [];
  fill($("check"), ...open.map((f) => el("div", { className: "hint" },
    el("p", { role: "alert" }, `${f.record}: ${f.sentence} ${f.remedy}`),
    ...(f.mendable ? [el("button", { className: "small", onclick: () => answer("mend", f.name) }, "Mend it")] : []),
    el("button", { className: "small", onclick: () => answer("accept", f.name) }, "Take it as it is"))));
  const asked = JSON.stringify([state.load, state.headers, !state.records]);
  if ($("read").dataset.shown !== asked) { // what is being typed stays
    $("read").dataset.shown = asked;
    fill($("read"), ...(state.load.sources.length ? [readAs()] : []));
  }
  const names = told ? told.records.map((r) => r.name) : [];
  $("which").hidden = names.length < 2;
  if ($("record").children.length !== names.length || [...$("record").children].some((o, k) => o.textContent !== names[k])) {
    fill($("record"), ...names.map((name, k) => el("option", { value: k }, name)));
    record = 0; span = null;
  }
}

function readAs() {
  // What was guessed is corrected here, not in the file.
  const said = state.load.sources[0].said;
  const fields = [["time", "column, '1 [s]'"], ["drive", "column, 'u [V]'"], ["position", "column, 'y [um]'"],
    ["rate", "'1 kHz'"], ["between", "as the file says", "linear", "held", "bandlimited"], ["period", "'0.2 s'"], ["startup", "'40 ms'"],
    ["trim", "'2 s:8 s'"], ["gain", "of the amplifier"], ["scale", "'2.5 um/V'"], ["decimal", "as the numbers show", ".", ","], ["record", "its name, or its number"]];
  const units = { time: ["s", "ms", "us"], drive: ["V", "mV", "kV"], position: ["um", "nm", "mm", "m"] };
  const choices = (name) => el("datalist", { id: `choices-${name}` }, ...state.headers.flatMap((h) =>
    (h.endsWith("]") ? [h] : units[name].map((u) => `${h} [${u}]`)).map((value) => el("option", { value }))));
  const inputs = fields.map(([name, hint, ...words]) => (words.length ? el("select", { "aria-label": name, name },
    ...[["", hint], ...words.map((w) => [w, w])].map(([value, text]) => el("option", { value, selected: value === (said[name] || "") }, text))) : el("input", { value: said[name] || "", placeholder: hint, "aria-label": name, name,
    ...(units[name] ? { list: `choices-${name}` } : {}) })));
  const read = () => post({ do: "load", load: { ...state.load, accept: [], mend: [],
    sources: state.load.sources.map((s) => ({ ...s, said: Object.fromEntries(inputs.map((i) => [i.name, i.value.trim()]).filter(([, v]) => v)) })) } });
  return el("details", { open: !state.records }, el("summary", {}, "Read it otherwise"),
    ...Object.keys(units).map(choices),
    ...inputs.map((input, k) => el("label", { className: "wide" }, fields[k][0], input)),
    el("button", { className: "small", onclick: read }, "Read again"));
}

function answer(how, name) {
  post({ do: "load", load: { ...state.load, [how]: [...state.load[how], name] } });
}

function modelPart() {
  const fit = state.fit, busy = !!state.busy && state.kind !== "score";
  $("model").hidden = !fit;
  if (!fit) return;
  fill($("effects"), ...fit.effects.map((e) => el("li", { title: `${e.place}: ${e.about}` },
    el("span", { className: "name" }, e.name),
    el("select", { "aria-label": `in the place of ${e.name}`, disabled: busy || !e.instead.length,
      onchange: (event) => post({ do: "exchange", name: e.name, effect: event.target.value }) },
      el("option", { value: "" }, "exchange"), ...e.instead.map((n) => el("option", { value: n }, n))),
    el("button", { className: "small", disabled: busy, title: `Remove ${e.name}`, "aria-label": `Remove ${e.name}`,
      onclick: () => post({ do: "remove", name: e.name }) }, "×"))));
  const all = [...new Set(fit.effects.flatMap((e) => e.instead).concat((state.scores ? state.scores.suspects : []).map((s) => s.name)))].sort();
  fill($("any"), el("option", { value: "" }, "choose"), ...all.map((n) => el("option", { value: n }, n)));
  $("any").disabled = busy;
  fill($("parameters").tBodies[0], ...[...fit.parameters].sort((a, b) => a.kept - b.kept).flatMap((p) => parameterRows(p, busy)));
}

function parameterRows(p, busy) {
  const spread = p.at_bound ? "at its bound" : p.kept ? "kept" : p.std === null ? "" : "± " + show(1.96 * p.std, p.unit);
  const low = el("input", { value: p.bounds[0] === null ? "" : p.bounds[0], placeholder: "none", "aria-label": `lower bound of ${p.name}` });
  const high = el("input", { value: p.bounds[1] === null ? "" : p.bounds[1], placeholder: "none", "aria-label": `upper bound of ${p.name}` });
  const form = el("tr", { hidden: true }, el("td", { colSpan: 3 }, el("span", { className: "bounds" },
    low, "to", high, p.unit === "1" ? "" : p.unit, el("button", { className: "small", disabled: busy,
      onclick: () => post({ do: "bound", name: p.name, low: Number(low.value), high: Number(high.value) }) }, "Set"))));
  return [el("tr", { title: p.about },
    el("td", {}, ...p.name.split(/(?<=[._])/).flatMap((part) => [part, el("wbr")]), el("br"), el("span", { className: "hint" }, spread)),
    el("td", { className: "number" }, show(p.value, p.unit)),
    el("td", { className: "number" },
      el("button", { className: "small", disabled: busy, title: p.kept ? `Estimate ${p.name}` : `Keep ${p.name} at this value`,
        onclick: () => post(p.kept ? { do: "free", name: p.name } : { do: "fix", name: p.name, value: p.value }) }, p.kept ? "free" : "fix"),
      el("button", { className: "small", title: `Bounds of ${p.name}`, onclick: () => { form.hidden = !form.hidden; } }, "[ ]"))), form];
}

function rightPart() {
  const busy = !!state.busy && state.kind !== "score", fit = state.fit;
  $("steps-part").hidden = !state.steps.length;
  fill($("steps"), ...state.steps.map((s, k) => el("li", { className: k === state.depth ? "now" : k > state.depth ? "undone" : "" },
    el("span", { className: "name" }, s.title), el("span", {}, said(s.rms_text) || "…"))));
  $("told").hidden = $("away").hidden = !fit;
  const items = (sentences) => sentences.map((s) => el("li", {}, said(s)));
  if (fit) {
    fill($("sentences"), ...items([fit.sentence, ...(state.where || [])]));
    fill($("more"), ...items([...fit.blind, ...fit.remarks]));
  }
  const scores = state.scores;
  $("missing").hidden = !fit;
  $("noise").textContent = scores ? said(scores.noise) + " Point at one to see it over the residual." : "Scoring what is absent …";
  $("find").disabled = busy;
  fill($("suspects"), ...(scores ? scores.suspects.slice(0, 12) : []).map((s) => suspectRow(s, busy)));
  $("unscored-part").hidden = !scores || !scores.unscored.length;
  if (scores) fill($("unscored"), ...scores.unscored.map((u) => el("li", {}, `${u.name}: ${u.why}`)));
  $("found").hidden = !state.sentences.length;
  fill($("answer"), ...items(state.sentences));
  planPart(busy);
  $("kept").textContent = `Every step is kept in ${state.file}.`;
}

async function preview(number, where) {
  if (where.children.length) { where.replaceChildren(); return; }
  const told = await ask("drive?" + new URLSearchParams({ number }));
  if (told) drawn(where, told.panels[0], { height: 150 });
}

function planPart(busy) {
  const plan = state.plan;
  $("next-part").hidden = !state.fit;
  $("next").hidden = !!plan;
  $("next").disabled = busy;
  const shown = JSON.stringify(plan);
  if ($("plan").dataset.shown === shown) return; // a preview that is open stays open
  $("plan").dataset.shown = shown;
  fill($("plan"), ...(plan ? plan.drives : []).map((d, k) => {
    const where = el("div", {});
    return el("li", {}, said(d.sentence), el("p", { className: "links" },
      el("button", { className: "small", onclick: () => preview(k, where) }, "Preview"),
      el("a", { href: `download/drive-${k}.csv`, download: "" }, "CSV to play")), where);
  }), ...(plan && plan.never.length ? [el("li", {}, `No drive would show ${plan.never.join(", ")}: change the set-up from one record to the next.`)] : []),
  ...(plan && !plan.drives.length && !plan.never.length ? [el("li", {}, "There is nothing hidden to be shown.")] : []));
}

function suspectRow(s, busy) {
  const percent = (x) => (100 * x).toFixed(x < 0.1 ? 1 : 0) + "\u00a0%";
  const alike = s.overlaps.map((o) => `${o.name} (${o.cosine.toFixed(2)})`).join(", ");
  const bar = el("i", {});
  bar.style.width = 100 * s.explains + "%";
  const note = s.wrong_side ? "Only with the wrong sign." : s.sure ? "" : "No more than noise would.";
  return el("li", { title: s.about, className: (s.sure ? "" : "weak") + (s.name === suspect ? " shown" : ""), "data-name": s.name,
    onmouseenter: () => overlay(s.name), onfocusin: () => overlay(s.name) },
    el("span", { className: "name" }, s.name),
    el("button", { className: "small", disabled: busy, title: `Add ${s.name} and fit again`, "aria-label": `Add ${s.name}`,
      onclick: () => { suspect = ""; post({ do: "add", effect: s.effect }); } }, "Add"),
    el("span", { className: "bar" }, bar),
    el("span", { className: "more" }, `explains ${percent(s.explains)}, leaves ${said(s.rms_text)}; visible ${percent(s.visibility)}. ` +
      (alike ? `Looks like ${alike}. ` : "") + note));
}

function status() {
  const busy = state.busy;
  $("cancel").hidden = !busy || state.kind === "look" || state.kind === "score";
  $("status").textContent = busy ? `${busy[0].toUpperCase()}${busy.slice(1)} …` : state.records ? "" : "Drop a record to begin.";
  const free = !busy || state.kind === "score";
  $("undo").disabled = !free || state.depth === 0;
  $("redo").disabled = !free || !(state.depth < state.steps.length - 1);
  $("fit").hidden = !state.records || state.steps.length > 0;
  $("fit").disabled = !free || !state.records || !state.records.fit_for_use;
  document.body.dataset.busy = state.kind;
  $("centre").hidden = !state.records;
  const settled = state.shown === state.depth;
  document.body.dataset.depth = state.fit && settled ? state.depth : "";
  document.body.dataset.scored = state.scores && settled ? "yes" : "";
}

function render(next) {
  const before = state;
  state = next;
  live = next.iterates;
  if (next.problem || (before && before.problem)) problem(next.problem);
  const names = (next.scores ? next.scores.suspects : []).map((s) => s.name);
  if (suspect && !names.includes(suspect)) suspect = "";
  recordsPart(); modelPart(); rightPart(); status();
  // Curves are asked for again where they may be others, not with every word that is told.
  const signals = next.records && next.records.records.map((r) => [r.name, r.samples, r["not counted"], r.remarks.length]);
  const curves = JSON.stringify([next.version, next.shown, signals, !!next.scores]);
  if (!next.records) { view = placed = null; build(); } else if (curves !== known) look(); else drawError();
  known = curves;
  if (!before || before.shown !== next.shown || !before.where !== !next.where) place();
}

// ---------------------------------------------------------------- listening and clicking

const source = new EventSource("events");
source.addEventListener("state", (event) => render(JSON.parse(event.data)));
source.addEventListener("begun", (event) => { state.solving = JSON.parse(event.data).depth; live = []; drawError(); });
source.addEventListener("iterate", (event) => {
  const told = JSON.parse(event.data);
  live.push(told.rms);
  const unit = state.records.records[record].units.position;
  $("status").textContent = `Fitting: iterate ${told.number}, rms ${show(told.rms, unit)}`;
  drawError();
});
source.addEventListener("drawn", () => look());
source.addEventListener("said", (event) => { $("status").textContent = JSON.parse(event.data); });
source.addEventListener("error", () => { if (state) $("status").textContent = SILENT; });

$("undo").addEventListener("click", () => post({ do: "undo" }));
$("redo").addEventListener("click", () => post({ do: "redo" }));
$("fit").addEventListener("click", () => post({ do: "fit" }));
$("find").addEventListener("click", () => post({ do: "find" }));
$("next").addEventListener("click", () => post({ do: "next" }));
$("cancel").addEventListener("click", () => post({ do: "cancel" }));
$("any").addEventListener("change", (event) => { if (event.target.value) post({ do: "add", effect: event.target.value }); });
$("record").addEventListener("change", (event) => { record = Number(event.target.value); look(null); place(); });
$("by").addEventListener("change", () => place());
$("suspects").addEventListener("mouseleave", () => overlay(""));

function darken(on) {
  document.documentElement.classList.toggle("dark", on);
  build();
}
$("theme").addEventListener("click", () => darken(!document.documentElement.classList.contains("dark")));
if (matchMedia("(prefers-color-scheme: dark)").matches) document.documentElement.classList.add("dark");

async function send(file) {
  if (!file) return;
  $("status").textContent = "Sending the file …";
  if (await ask("upload?" + new URLSearchParams({ name: file.name }), { method: "POST", body: file })) problem("");
  $("file").value = ""; // the same one can be chosen again
}
$("file").addEventListener("change", (event) => send(event.target.files[0]));
for (const name of ["dragover", "dragenter"]) addEventListener(name, (event) => { event.preventDefault(); $("drop").classList.add("over"); });
addEventListener("dragleave", () => $("drop").classList.remove("over"));
addEventListener("drop", (event) => { event.preventDefault(); $("drop").classList.remove("over"); send(event.dataTransfer.files[0]); });

addEventListener("click", (event) => {
  const link = event.target.closest("a[download]");
  if (!link) return;
  event.preventDefault();
  takeAway(link);
});

addEventListener("keydown", (event) => {
  if (/^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName) || event.ctrlKey || event.metaKey || event.altKey) return;
  const keys = {
    u: () => $("undo").click(), r: () => $("redo").click(), Escape: () => { if (!$("cancel").hidden) $("cancel").click(); },
    0: () => look(null), "+": () => move(0, 0.5), "-": () => move(0, 2), ArrowLeft: () => move(-0.25, 1), ArrowRight: () => move(0.25, 1),
  };
  if (keys[event.key]) { event.preventDefault(); keys[event.key](); }
});

let resized;
addEventListener("resize", () => { clearTimeout(resized); resized = setTimeout(build, 100); });
