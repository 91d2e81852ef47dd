"use strict";
// Draws a panel of a picture as the server made it: axes, traces, units and colours are told there.

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

function letters(size) {
  // Wide screens have larger letters, in pictures as in words.
  return `${(size * parseFloat(getComputedStyle(document.documentElement).fontSize)) / 14}px system-ui`;
}

function digits(x, n = 4) {
  if (x !== 0 && (Math.abs(x) < 1e-3 || Math.abs(x) >= 1e6)) return Number(x.toPrecision(n)).toExponential();
  return Number(x.toPrecision(n)).toString();
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

function axis(told, about) {
  const numbers = (u, all) => all.map((v) => (v === null ? "" : digits(v)));
  return {
    label: told.label, stroke: css("ink"), labelSize: 18, labelFont: letters(12), font: letters(11),
    grid: { stroke: css("line"), width: 1 }, ticks: { stroke: css("line"), width: 1 }, values: numbers,
    ...(told.logarithmic ? { splits: (u, index, low, high) => ticks(low, high), filter: (u, all) => all } : {}), ...about,
  };
}

function wash(u, colour, begin, end) {
  // A stretch of the abscissa in a colour, within the axes.
  const from = Math.max(u.valToPos(begin, "x", true), u.bbox.left);
  const to = Math.min(u.valToPos(end, "x", true), u.bbox.left + u.bbox.width);
  u.ctx.save();
  u.ctx.fillStyle = css(colour);
  u.ctx.globalAlpha = colour === "raised" ? 1 : 0.25;
  if (to > from) u.ctx.fillRect(from, u.bbox.top, Math.max(to - from, 1), u.bbox.height);
  u.ctx.restore();
}

function across(u, height, dash) {
  // A line through all of the abscissa.
  const y = Math.round(u.valToPos(height, "y", true)) + 0.5;
  if (!(y > u.bbox.top && y < u.bbox.top + u.bbox.height)) return;
  u.ctx.save();
  u.ctx.strokeStyle = css("quiet"); u.ctx.lineWidth = devicePixelRatio; u.ctx.setLineDash(dash);
  u.ctx.beginPath(); u.ctx.moveTo(u.bbox.left, y); u.ctx.lineTo(u.bbox.left + u.bbox.width, y); u.ctx.stroke();
  u.ctx.restore();
}

function marked(u, panel) {
  if (panel.zero) across(u, 0, []);
  if (!panel.level) return;
  const [height, says] = panel.level;
  across(u, height, [6 * devicePixelRatio, 4 * devicePixelRatio]);
  u.ctx.save();
  u.ctx.fillStyle = css("quiet"); u.ctx.textAlign = "left"; u.ctx.textBaseline = "alphabetic"; u.ctx.font = letters(11 * devicePixelRatio);
  u.ctx.fillText(says, u.bbox.left + 4 * devicePixelRatio, u.valToPos(height, "y", true) - 4 * devicePixelRatio);
  u.ctx.restore();
}

function path(trace, index) {
  // Points in the order in which they are joined, or points alone: abscissas need not rise.
  return (u) => {
    uPlot.orient(u, index, (series, xs, ys, scaleX, scaleY, toX, toY, left, top, width, height) => {
      const [x, y] = u.data[index], line = new Path2D(), dots = new Path2D();
      const size = (trace.style === "cloud" ? 1.5 : x.length > 40 ? 2 : 3) * devicePixelRatio;
      let open = false;
      for (let k = 0; k < x.length; k++) {
        if (y[k] === null) { open = false; continue; }
        const a = toX(x[k], scaleX, width, left), b = toY(y[k], scaleY, height, top);
        if (open) line.lineTo(a, b); else line.moveTo(a, b);
        open = true;
        if (trace.style !== "line") dots.rect(a - size, b - size, 2 * size, 2 * size);
      }
      u.ctx.save();
      u.ctx.beginPath(); u.ctx.rect(left, top, width, height); u.ctx.clip();
      u.ctx.strokeStyle = u.ctx.fillStyle = css(trace.tone);
      u.ctx.lineWidth = 1.5 * devicePixelRatio;
      if (trace.style !== "cloud") u.ctx.stroke(line);
      u.ctx.globalAlpha = trace.style !== "cloud" ? 1 : x.length > 300 ? 0.25 : 0.6;
      u.ctx.fill(dots);
      u.ctx.restore();
    });
    return null;
  };
}

function rows(panel) {
  // A panel's numbers as uPlot takes them.
  if (panel.x === null) return [null, ...panel.traces.map((t) => [t.x, t.y])];
  return [panel.x, ...panel.traces.flatMap((t) => (t.style === "band" ? [t.high, t.y] : [t.y]))];
}

function lines(panel, many) {
  // Series and bands of traces that share their abscissas.
  const series = [{ label: panel.across.label }], bands = [];
  for (const t of panel.traces) {
    const quiet = t.label ? {} : { class: "unnamed" };
    if (t.style === "band") {
      const edge = { stroke: css(t.tone), width: 0, points: { show: false }, class: "unnamed" };
      bands.push({ series: [series.length, series.length + 1], fill: css(t.tone) + "33" });
      series.push(edge, { ...edge });
    } else series.push({
      label: t.label || "value", stroke: css(t.tone), width: t.style === "cloud" ? 0 : 1.5, ...quiet,
      points: { show: t.style !== "line", size: t.style === "cloud" ? 8 : many ? 3 : 6, fill: css(t.tone) },
    });
  }
  return { series, bands };
}

const likeness = (panel) => JSON.stringify([panel.across, panel.up, panel.x === null, panel.traces.map((t) => [t.label, t.tone, t.style])]);

function drawn(where, panel, about = {}) {
  // A new plot of a panel; `about` is what a place adds: size, cursor, hooks.
  const shared = panel.x !== null, { hooks = {}, height, marks = () => [], onSelect, sync, ...more } = about;
  const points = panel.traces.reduce((most, t) => Math.max(most, t.y.length), 0);
  const named = panel.traces.some((t) => t.label);
  let current = panel;
  const y = panel.limits ? { range: (u, low, high) => [current.limits[0], current.limits[1] ?? high * 1.05] }
    : panel.up.logarithmic ? { range: (u, low, high) => (low > 0 ? [low / 1.2, high * 1.2] : [1, 10]) } : {};
  const x = panel.across.logarithmic ? { range: (u, low, high) => (low > 0 ? [low, high] : [1, 10]) } : {};
  const { series, bands } = shared ? lines(panel, points > 40)
    : { series: [{}, ...panel.traces.map((t, k) => ({ label: t.label, ...(t.label ? {} : { class: "unnamed" }), stroke: css(t.tone),
      facets: [{ scale: "x", auto: true }, { scale: "y", auto: true }], paths: path(t, k + 1) }))], bands: [] };
  const high = (height || where.clientHeight) - (named ? 26 : 4);
  // A label that is longer than its axis is written smaller.
  const size = Math.max(9, Math.min(12, (1.75 * (high - 50)) / panel.up.label.length));
  const plot = new uPlot({
    mode: shared ? 1 : 2,
    width: where.clientWidth, height: high, padding: [8, 12, 0, 0],
    scales: { x: { time: false, distr: panel.across.logarithmic ? 3 : 1, ...x }, y: { distr: panel.up.logarithmic ? 3 : 1, ...y } },
    axes: [axis(panel.across, { size: 34, ...(about.across || {}) }), axis(panel.up, { size: 58, space: 24, labelFont: letters(size) })],
    series, bands,
    legend: { show: named, live: shared },
    cursor: shared ? { sync: sync ? { key: sync } : undefined, drag: { x: !!onSelect, y: false, setScale: false },
      bind: onSelect ? { dblclick: () => () => { onSelect(null); } } : {} } : { show: false },
    hooks: {
      drawClear: [(u) => {
        if (current.shaded) wash(u, "raised", current.shaded[0], current.shaded[1]);
        for (const [begin, end] of marks()) wash(u, "blue", begin, end);
      }],
      draw: [(u) => marked(u, current)],
      setSelect: onSelect ? [(u) => {
        if (u.select.width < 4) return;
        const ends = [u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x")];
        u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
        onSelect(ends);
      }] : [],
    },
  }, rows(panel), where);
  plot.root.setAttribute("role", "group");
  plot.root.setAttribute("aria-label", `${panel.title || "Curves"}: ${panel.up.label} over ${panel.across.label}`);
  if (panel.title) where.prepend(Object.assign(document.createElement("h3"), { textContent: panel.title }));
  return {
    plot, likeness: likeness(panel),
    redraw: () => plot.redraw(false, true),
    renew(next, ends) { current = next; plot.batch(() => { plot.setData(rows(next), !ends); if (ends) plot.setScale("x", { min: ends[0], max: ends[1] }); }); },
    destroy() { plot.destroy(); where.replaceChildren(); },
  };
}
