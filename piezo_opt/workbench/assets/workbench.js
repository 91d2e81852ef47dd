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

function digits(x, n = 4) {
  if (x !== 0 && (Math.abs(x) < 1e-3 || Math.abs(x) >= 1e6)) return Number(x.toPrecision(n)).toExponential();
  return Number(x.toPrecision(n)).toString();
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
let view = null; // curves of the stretch that is looked at
let span = null; // [begin, end] of that stretch, or null for the whole
let suspect = ""; // whose curve lies over the residual
let record = 0;
let live = []; // iterates of the step that is being solved
let plots = {};
let asked = 0;
let marks = []; // stretches of time that were brushed in the plane

async function post(body) {
  const answer = await fetch("do", {
    method: "POST",
    headers: { "content-type": "application/json" },
    body: JSON.stringify({ version: state.version, ...body }),
  });
  if (!answer.ok) problem((await answer.json()).sentence);
  else problem("");
}

function problem(sentence) {
  $("problem").hidden = !sentence;
  $("problem").textContent = sentence;
}

// ---------------------------------------------------------------- curves

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function axis(label, about) {
  return {
    label, stroke: css("--ink"), labelSize: 18, labelFont: "12px system-ui", font: "11px system-ui",
    grid: { stroke: css("--line"), width: 1 }, ticks: { stroke: css("--line"), width: 1 }, ...about,
  };
}

function overTime(key, yLabel, series) {
  const where = $(key);
  const options = {
    width: where.clientWidth, height: where.clientHeight - 26,
    scales: { x: { time: false } },
    axes: [axis("time [s]", { size: 34 }), axis(yLabel, { size: 54, space: 24 })],
    series: [{ label: "time [s]" }, ...series],
    cursor: {
      sync: { key: "time" }, drag: { x: true, y: false, setScale: false },
      bind: { dblclick: () => () => { look(null); } },
    },
    hooks: {
      drawClear: [(u) => {
        u.ctx.save();
        u.ctx.globalAlpha = 0.25; u.ctx.fillStyle = css("--suspect");
        for (const [begin, end] of marks) {
          const from = Math.max(u.valToPos(begin, "x", true), u.bbox.left);
          const to = Math.min(u.valToPos(end, "x", true), u.bbox.left + u.bbox.width);
          if (to > from) u.ctx.fillRect(from, u.bbox.top, Math.max(to - from, 1), u.bbox.height);
        }
        u.ctx.restore();
      }],
      setSelect: [(u) => {
        if (u.select.width < 4) return;
        const ends = [u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x")];
        u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
        look(ends);
      }],
    },
  };
  return new uPlot(options, [[], ...series.map(() => [])], where);
}

function drawn(u, index) {
  // A curve in the plane: its points in the order in which they were played.
  uPlot.orient(u, index, (series, xs, ys, scaleX, scaleY, toX, toY, left, top, width, height) => {
    const [x, y] = u.data[index];
    const path = new Path2D();
    let open = false;
    for (let k = 0; k < x.length; k++) {
      if (y[k] === null) { open = false; continue; }
      const a = toX(x[k], scaleX, width, left), b = toY(y[k], scaleY, height, top);
      if (open) path.lineTo(a, b); else path.moveTo(a, b);
      open = true;
    }
    u.ctx.save();
    u.ctx.beginPath(); u.ctx.rect(left, top, width, height); u.ctx.clip();
    u.ctx.strokeStyle = series.stroke(u, index); u.ctx.lineWidth = 1.5 * devicePixelRatio;
    u.ctx.stroke(path);
    u.ctx.restore();
  });
  return null;
}

function inPlane(xLabel, yLabel) {
  const where = $("plane");
  const facets = () => [{ scale: "x", auto: true }, { scale: "y", auto: true }];
  return new uPlot({
    mode: 2, width: where.clientWidth, height: where.clientHeight - 4,
    legend: { show: false }, cursor: { show: false },
    scales: { x: { time: false }, y: {} },
    axes: [axis(xLabel, { size: 34 }), axis(yLabel, { size: 54, space: 24 })],
    series: [{}, { facets: facets(), stroke: css("--measured"), paths: drawn },
      { facets: facets(), stroke: css("--model"), paths: drawn }],
  }, [null, [[], []], [[], []]], where);
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
    if (right - left < 4 || bottom - top < 4) { brush(null); return; }
    const [position, drive] = [plots.units.position[0], plots.units.drive[0]];
    brush({ left: u.posToVal(left, "x") / drive, right: u.posToVal(right, "x") / drive,
      low: u.posToVal(bottom, "y") / position, high: u.posToVal(top, "y") / position });
  });
}

async function brush(rectangle) {
  let told = { stretches: [], samples: 0 };
  if (rectangle) {
    const answer = await fetch("brushed?" + new URLSearchParams({ record, ...rectangle }));
    if (!answer.ok) { problem((await answer.json()).sentence); return; }
    told = await answer.json();
  } else for (const box of document.querySelectorAll("#plane .u-select")) Object.assign(box.style, { width: "0", height: "0" });
  marks = told.stretches;
  $("brushed").textContent = rectangle ? `${told.samples} samples inside` : "";
  for (const key of ["overlay", "residual"]) if (plots[key]) plots[key].redraw(false, true);
}

function ticks(low, high) {
  // Round numbers along a logarithmic axis: 1, 2, 5 of each decade, or even steps within one.
  const even = (high - low) / 4, power = 10 ** Math.floor(Math.log10(even));
  if (high / low < 10) {
    const step = power * [1, 2, 5, 10].find((k) => k * power >= even);
    return Array.from({ length: Math.floor(high / step) - Math.ceil(low / step) + 1 }, (_, k) => (Math.ceil(low / step) + k) * step);
  }
  const found = [];
  for (let decade = 10 ** Math.floor(Math.log10(low)); decade <= high; decade *= 10)
    for (const k of high / low < 1e3 ? [1, 2, 5] : [1]) if (k * decade >= low && k * decade <= high) found.push(k * decade);
  return found;
}

function ofError(unit) {
  const where = $("error");
  return new uPlot({
    width: where.clientWidth, height: where.clientHeight - 26,
    // A logarithmic scale of its own choice would reach to whole decades.
    scales: { x: { time: false }, y: { distr: 3, range: (u, low, high) => (low > 0 ? [low / 1.2, high * 1.2] : [1, 10]) } },
    axes: [axis("iterate", { size: 34, incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000] }),
      axis(`rms error [${unit}]`, { size: 54, splits: (u, index, low, high) => ticks(low, high), filter: (u, all) => all, values: (u, all) => all.map((v) => (v === null ? "" : digits(v))) })],
    series: [{ label: "iterate" },
      { label: "rms", stroke: css("--model"), width: 2, points: { show: false } },
      { label: "step", stroke: css("--suspect"), width: 0, points: { show: true, size: 8, fill: css("--suspect") } }],
    cursor: { drag: { x: false, y: false } },
  }, [[], [], []], where);
}

function build() {
  for (const plot of Object.values(plots)) plot.destroy();
  plots = {};
  if (!view || !state.records) return;
  const units = state.records.records[record].units;
  const [position, drive] = [units.position, units.drive];
  const at = {
    position: prefixed(position, largest(view.position, view.model)),
    residual: prefixed(position, largest(view.residual, view.suspect)),
    drive: prefixed(drive, largest(view.plane.drive)),
    error: prefixed(position, largest(...state.steps.map((s) => s.trace), live)),
  };
  const line = (label, colour, about) => ({ label, stroke: css(colour), width: 1.5, points: { show: false }, ...about });
  plots.units = { destroy() {}, ...at, key: JSON.stringify(at) };
  plots.overlay = overTime("overlay", `displacement [${at.position[1]}]`,
    [line("measured", "--measured"), line("modelled", "--model")]);
  plots.residual = overTime("residual", `residual [${at.residual[1]}]`,
    [line("residual", "--residual", { width: 1 }), line("suspect", "--suspect", { width: 2 })]);
  plots.plane = inPlane(`drive [${at.drive[1]}]`, `displacement [${at.position[1]}]`);
  brushable(plots.plane);
  plots.error = ofError(at.error[1]);
  draw();
  place();
}

function draw() {
  if (!plots.overlay) return;
  const at = plots.units, none = view.time.map(() => null);
  const set = (plot, ...rows) => {
    plot.batch(() => {
      plot.setData([view.time, ...rows], false);
      plot.setScale("x", { min: span ? span[0] : view.time[0], max: span ? span[1] : view.time[view.time.length - 1] });
    });
  };
  set(plots.overlay, scaled(view.position, at.position[0]), view.model ? scaled(view.model, at.position[0]) : none);
  set(plots.residual, view.residual ? scaled(view.residual, at.residual[0]) : none,
    view.suspect ? scaled(view.suspect, at.residual[0]) : none);
  const p = view.plane, x = scaled(p.drive, at.drive[0]);
  plots.plane.setData([null, [x, scaled(p.position, at.position[0])],
    p.model ? [x, scaled(p.model, at.position[0])] : [[], []]]);
  $("shown").textContent = suspect && view.suspect ? `and what ${suspect} would explain of it` : "";
  $("span").textContent = span ? `${digits(span[0])} s to ${digits(span[1])} s, ${view.samples} samples` : `${view.samples} samples`;
  drawError();
}

function drawError() {
  if (!plots.error) return;
  const rms = [], ends = [];
  const last = state.solving >= 0 ? state.solving - 1 : state.depth;
  state.steps.slice(0, last + 1).forEach((step) => {
    step.trace.forEach((value, k) => { rms.push(value); ends.push(k === step.trace.length - 1 ? value : null); });
  });
  live.forEach((value) => { rms.push(value); ends.push(null); });
  const factor = plots.units.error[0];
  plots.error.setData([rms.map((_, k) => k + 1), scaled(rms, factor), scaled(ends, factor)]);
}

async function place() {
  // Where the residual lives: asked for again whenever another fit or record is shown.
  $("place-part").hidden = !state || !state.fit;
  if ($("place-part").hidden) return;
  const answer = await fetch("place?" + new URLSearchParams({ record, by: $("by").value }));
  if (!answer.ok) { problem((await answer.json()).sentence); return; }
  const told = await answer.json(), where = $("place");
  for (const option of $("by").options) option.disabled = !told.views.includes(option.value);
  if (plots.place) plots.place.destroy();
  const [factor, unit] = prefixed(told.up_unit, largest(...told.curves.map((c) => c.values)));
  const colours = [css("--suspect"), css("--model"), css("--quiet")];
  const spread = told.curves.length === 3; // one curve between its two limits
  const numbers = (u, all) => all.map((v) => (v === null ? "" : digits(v)));
  plots.place = new uPlot({
    width: where.clientWidth, height: where.clientHeight - 26,
    scales: { x: { time: false, distr: told.logarithmic ? 3 : 1 }, y: { distr: told.logarithmic === "both" ? 3 : 1 } },
    axes: [axis(`${told.across} [${told.unit}]`, { size: 34, values: numbers }), axis(`${told.up} [${unit}]`, { size: 60, space: 24, values: numbers })],
    series: [{ label: told.across }, ...told.curves.map((c, k) => ({
      label: c.label, stroke: colours[spread && k ? 2 : k], width: spread && k ? 1 : 2,
      dash: spread && k ? [4, 4] : k === 1 ? [8, 3] : undefined,
      points: { show: told.x.length < 40 && !(spread && k), size: 6 } }))],
    cursor: { drag: { x: false, y: false } },
  }, [told.x, ...told.curves.map((c) => scaled(c.values, factor))], where);
}

async function look(ends) {
  if (!state || !state.records) return;
  if (ends === null && marks.length) brush(null);
  if (ends !== undefined) {
    const whole = state.records.records[record].span;
    span = ends && [Math.max(ends[0], whole[0]), Math.min(ends[1], whole[1])];
    if (span && !(span[1] > span[0])) span = null;
  }
  const mine = ++asked;
  const query = new URLSearchParams({ record });
  if (span) { query.set("begin", span[0]); query.set("end", span[1]); }
  if (suspect) query.set("suspect", suspect);
  const answer = await fetch("view?" + query);
  if (mine !== asked) return; // a later one is on its way
  if (!answer.ok) { problem((await answer.json()).sentence); return; }
  view = await answer.json();
  const units = state.records.records[record].units;
  const now = JSON.stringify({
    position: prefixed(units.position, largest(view.position, view.model)),
    residual: prefixed(units.position, largest(view.residual, view.suspect)),
    drive: prefixed(units.drive, largest(view.plane.drive)),
    error: prefixed(units.position, largest(...state.steps.map((s) => s.trace), live)),
  });
  if (!plots.overlay || plots.units.key !== now) build(); else draw();
}

function move(shift, zoom) {
  if (!state || !state.records) return;
  const whole = state.records.records[record].span;
  const [a, b] = span || whole, middle = (a + b) / 2 + shift * (b - a), half = ((b - a) / 2) * zoom;
  if (2 * half >= whole[1] - whole[0]) { look(null); return; }
  const begin = Math.min(Math.max(middle - half, whole[0]), whole[1] - 2 * half);
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
    ["rate", "'1 kHz'"], ["period", "'0.2 s'"], ["startup", "'40 ms'"], ["gain", "of the amplifier"], ["scale", "'2.5 um/V'"]];
  const units = { time: ["s", "ms", "us"], drive: ["V", "mV", "kV"], position: ["um", "nm", "mm", "m"] };
  const choices = (name) => el("datalist", { id: `choices-${name}` }, ...state.headers.flatMap((h) =>
    (h.endsWith("]") ? [h] : units[name].map((u) => `${h} [${u}]`)).map((value) => el("option", { value }))));
  const inputs = fields.map(([name, hint]) => el("input", { value: said[name] || "", placeholder: hint, "aria-label": name, name,
    ...(units[name] ? { list: `choices-${name}` } : {}) }));
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
    fill($("sentences"), ...items([fit.sentence, ...fit.sentences]));
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
  const answer = await fetch("drive?" + new URLSearchParams({ number }));
  if (!answer.ok) { problem((await answer.json()).sentence); return; }
  const told = await answer.json();
  new uPlot({
    width: where.clientWidth, height: 130, legend: { show: false }, cursor: { show: false },
    scales: { x: { time: false } },
    axes: [axis("time [s]", { size: 30 }), axis(`drive [${told.unit}]`, { size: 46, space: 24 })],
    series: [{}, { stroke: css("--suspect"), width: 1, points: { show: false } }],
  }, [told.time, told.drive], where);
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
  if (!next.records) { view = null; build(); } else look();
  if (!before || before.shown !== next.shown || !before.fit !== !next.fit) place();
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
source.addEventListener("said", (event) => { $("status").textContent = JSON.parse(event.data); });
source.addEventListener("error", () => { if (state) $("status").textContent = "The server does not answer: start it again with --session."; });

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
  const answer = await fetch("upload?" + new URLSearchParams({ name: file.name }), { method: "POST", body: file });
  problem(answer.ok ? "" : (await answer.json()).sentence);
}
$("file").addEventListener("change", (event) => send(event.target.files[0]));
for (const name of ["dragover", "dragenter"]) addEventListener(name, (event) => { event.preventDefault(); $("drop").classList.add("over"); });
addEventListener("dragleave", () => $("drop").classList.remove("over"));
addEventListener("drop", (event) => { event.preventDefault(); $("drop").classList.remove("over"); send(event.dataTransfer.files[0]); });

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
