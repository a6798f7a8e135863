"use strict";
// The page's views. All of them follow the question and the group of tasks that are chosen at the top.

const data = JSON.parse(document.getElementById("data").textContent, (key, value) => (value === "inf" ? Infinity : value));
const {contestants, tasks, metrics, runs} = data;
const byId = (id) => document.getElementById(id);
const state = {question: data.questions[0].name, group: "all", task: 0, cost: "fit_seconds", shown: null,
  curves: null, against: data.baseline ?? 0, contestant: null};
const question = () => data.questions.find((q) => q.name === state.question);
const board = () => data.boards.find((b) => b.question === state.question && b.group === state.group);
const unitOf = (metric, t) => tasks[t].units[metric] ?? "";
const plural = (count, word) => `${count} ${word}${count === 1 ? "" : "s"}`;
const between = (e, digits = 3) => (finite(e[1]) ? `${number(e[1], digits)} – ${number(e[2], digits)}` : "");

const percent = (v) => (finite(v) ? `${Math.round(100 * v)} %` : "–");

function badge(contestant) {
  return contestant.role ? element("span", {class: `role ${contestant.role}`}, contestant.role) : "";
}

function nameCell(m, extra = "") {
  return element("th", {scope: "row", class: "name", "data-v": contestants[m].name, title: contestants[m].key},
    breakable(contestants[m].name), " ", badge(contestants[m]), extra);
}

// A name that may be broken after its underscores.
function breakable(name) {
  return element("span", {}, ...name.split("_").flatMap((part, k) => (k ? ["_", element("wbr"), part] : [part])));
}

function head(...titles) {
  return element("thead", {}, element("tr", {}, ...titles.map((t) => (Array.isArray(t)
    ? element("th", {scope: "col", class: "n", title: t[1]}, t[0]) : element("th", {scope: "col"}, t)))));
}

// ---- standings

function drawStandings() {
  const {standings, tasks: pooled, left_out, without_noise_floor} = board();
  const base = data.baseline === null ? null : contestants[data.baseline].name;
  const rows = standings.map((s, place) => {
    const lost = s.failed + s.skipped;
    return element("tr", {class: contestants[s.contestant].role},
      element("td", {class: "n soft", "data-v": place + 1}, String(place + 1)),
      nameCell(s.contestant),
      element("td", {class: "bar", "data-v": s.score[0]}, intervalBar(s.score)),
      cell(s.score[0], `${number(s.score[0])}`, between(s.score)),
      cell(s.rank[0], number(s.rank[0]), between(s.rank)),
      cell(s.improvement[0], percent(s.improvement[0]), finite(s.improvement[1]) ? `${percent(s.improvement[1])} – ${percent(s.improvement[2])}` : ""),
      cell(s.tasks, `${s.tasks} of ${pooled.length}`, plural(s.runs, "run"), s.tasks < pooled.length ? "warn" : ""),
      cell(lost, s.failed ? `${s.failed} failed` : s.skipped ? `${s.skipped} skipped` : "–", s.failed && s.skipped ? `${s.skipped} skipped` : "", s.failed ? "warn" : ""),
      cell(s.fit_seconds, quantity(s.fit_seconds, "s", 2)),
      cell(s.step_microseconds, finite(s.step_microseconds) ? `${number(s.step_microseconds, 2)} µs` : "–"),
      cell(s.parameter_count, finite(s.parameter_count) ? String(Math.round(s.parameter_count)) : "–"));
  });
  const table = element("table", {class: "standings"},
    head("", "Contestant", "", ["Score", "Interquartile mean; 95 % interval over seeds"], ["Mean rank", "1 is best; on single runs"],
      [base ? `Beats ${base}` : "Beats the baseline", "Chance on the same task and seed"], ["Tasks", "Pooled tasks with a result"], ["Lost", "Runs without a result"],
      ["Fit", "Median time"], ["Step", "Median time per simulated sample"], ["Numbers", "That the model carries"]),
    element("tbody", {}, ...rows));
  sortable(table);
  const notes = [];
  if (standings.some((s) => s.tasks < pooled.length)) notes.push("Scores of contestants that take part in fewer tasks are not strictly comparable.");
  if (without_noise_floor.length) notes.push(`Noise floor unknown, the ceiling's or else the least error stands for it: ${without_noise_floor.join(", ")}.`);
  if (left_out.length) notes.push(`Not pooled, because nobody can gain there or the constant predictor has no result: ${left_out.join(", ")}.`);
  byId("standings").replaceChildren(rows.length ? element("div", {class: "scroll"}, table) : element("p", {}, "No contestant has a score here."),
    ...notes.map((note) => element("p", {class: "note"}, note)));
}

function cell(value, text, small = "", tone = "") {
  return element("td", {class: `n ${tone}`, "data-v": finite(value) ? value : ""}, text, small ? element("small", {}, small) : null);
}

function intervalBar(estimate) {
  const width = 130, height = 18, most = Math.max(1.05, ...board().standings.map((s) => s.score[2] ?? s.score[0]));
  const x = scale(0, most, 4, width - 4, false), svg = canvas(width, height, `score ${number(estimate[0])}`);
  svg.append(shape("line", {x1: x.at(0), x2: x.at(0), y1: 1, y2: 17, class: "zero"}), shape("line", {x1: x.at(1), x2: x.at(1), y1: 1, y2: 17, class: "one"}));
  if (finite(estimate[1])) svg.append(shape("line", {x1: x.at(estimate[1]), x2: x.at(estimate[2]), y1: 9, y2: 9, class: "interval"}));
  svg.append(shape("circle", {cx: x.at(estimate[0]), cy: 9, r: 3, class: "dot"}));
  return svg;
}

// ---- cost against score

const COSTS = {fit_seconds: "Median time of the fit (s)", step_microseconds: "Median time per simulated sample (µs)", parameter_count: "Numbers that the model carries"};

function drawCost() {
  const place = byId("cost-chart"), width = place.clientWidth, height = Math.min(440, Math.max(300, 0.55 * width));
  const shown = board().standings.filter((s) => finite(s[state.cost]) && s[state.cost] > 0);
  if (!shown.length) return place.replaceChildren(element("p", {}, "No contestant has such a figure here."));
  const frame = {left: 52, right: width - 10, top: 10, bottom: height - 44}, svg = canvas(width, height, "score against cost");
  const costs = shown.map((s) => s[state.cost]), tops = shown.map((s) => s.score[2] ?? s.score[0]), lows = shown.map((s) => s.score[1] ?? s.score[0]);
  const x = scale(Math.min(...costs) / 1.6, Math.max(...costs) * 1.6, frame.left, frame.right, true);
  const y = scale(Math.min(0, ...lows), Math.max(1.05, ...tops), frame.bottom, frame.top, false);
  axes(svg, frame, x, y, COSTS[state.cost], "Score (1: noise floor)");
  const front = shown.filter((s) => !contestants[s.contestant].role && !shown.some((o) => o !== s && !contestants[o.contestant].role
    && o[state.cost] <= s[state.cost] && o.score[0] >= s.score[0] && (o[state.cost] < s[state.cost] || o.score[0] > s.score[0])))
    .sort((a, b) => a[state.cost] - b[state.cost]);
  if (front.length > 1) svg.append(shape("path", {d: "M" + front.map((s) => `${x.at(s[state.cost])},${y.at(s.score[0])}`).join("L"), class: "front"}));
  const points = [];
  for (const s of shown) {
    const c = contestants[s.contestant], px = x.at(s[state.cost]), py = y.at(s.score[0]), best = front.includes(s);
    if (finite(s.score[1])) svg.append(shape("line", {x1: px, x2: px, y1: y.at(s.score[1]), y2: y.at(s.score[2]), class: "whisker"}));
    const mark = c.role ? shape("rect", {x: px - 5, y: py - 5, width: 10, height: 10, class: "role-mark"}) : shape("circle", {cx: px, cy: py, r: 5, class: best ? "best" : "other"});
    svg.append(titled(mark, `${c.name}: score ${number(s.score[0])}, ${number(s[state.cost], 2)}`));
    points.push({x: px, y: py, label: c.name, first: best || c.role});
  }
  points.sort((a, b) => Boolean(b.first) - Boolean(a.first));
  placeLabels(svg, points, frame);
  place.replaceChildren(svg);
}

// ---- relative improvement

function drawImprovement() {
  const place = byId("improvement-chart"), width = place.clientWidth, metric = question().metric, m = state.contestant;
  const lines = [], without = [];
  for (const t of board().tasks) {
    const pairs = ratios(t, m, state.against, metric);
    if (pairs.length) lines.push({t, pairs, middle: median(pairs)});
    else without.push(tasks[t].name);
  }
  lines.sort((a, b) => a.middle - b.middle);
  const known = lines.flatMap((line) => line.pairs).filter((v) => finite(v) && v > 0);
  if (!known.length) return place.replaceChildren(element("p", {}, "These two have no finished run in common here."));
  const label = Math.min(0.42 * width, 7.3 * Math.max(...lines.map((l) => tasks[l.t].name.length)) + 10), row = 22;
  const frame = {left: label, right: width - 14, top: 24, bottom: 24 + row * lines.length}, svg = canvas(width, frame.bottom + 46, "error ratios by task");
  const x = scale(Math.min(0.9, ...known) / 1.15, Math.max(1.1, ...known) * 1.15, frame.left, frame.right, true);
  axes(svg, frame, x, {ticks: [], at: () => 0}, `Error over that of ${contestants[state.against].name}`, "");
  svg.append(shape("line", {x1: x.at(1), x2: x.at(1), y1: frame.top, y2: frame.bottom, class: "zero"}));
  svg.append(shape("text", {x: x.at(1) - 8, y: 15, "text-anchor": "end", class: "tick"}, "← better"));
  if (x.at(1) + 60 < width) svg.append(shape("text", {x: x.at(1) + 8, y: 15, class: "tick"}, "worse →"));
  lines.forEach((line, k) => {
    const y = frame.top + row * (k + 0.5), name = tasks[line.t].name, room = Math.floor((label - 10) / 7);
    svg.append(titled(shape("text", {x: label - 8, y: y + 4, "text-anchor": "end", class: "label"}, name.length > room ? name.slice(0, room - 1) + "…" : name), tasks[line.t].title));
    const inside = line.pairs.filter((v) => finite(v) && v > 0), colour = line.middle <= 1 ? COLOURS[0] : COLOURS[1];
    if (inside.length > 1) svg.append(shape("line", {x1: x.at(Math.min(...inside)), x2: x.at(Math.max(...inside)), y1: y, y2: y, stroke: colour, "stroke-width": 2, opacity: 0.45}));
    const told = `${name}: ${number(line.middle)} times the error; ${plural(line.pairs.length, "seed")}`;
    if (finite(line.middle)) svg.append(titled(line.middle <= 1 ? shape("circle", {cx: x.at(line.middle), cy: y, r: 5, fill: colour})
      : shape("path", {d: `M${x.at(line.middle)},${y - 6}l6,6l-6,6l-6,-6z`, fill: colour}), told));
    else svg.append(titled(shape("text", {x: frame.right - 4, y: y + 4, "text-anchor": "end", class: "lost"}, "no result ✕"), told));
  });
  const better = lines.filter((line) => line.middle < 1).length;
  place.replaceChildren(svg, element("p", {class: "note"}, `Better on ${better} of ${plural(lines.length, "task")}. Marks are medians over seeds, lines their range; both contestants saw the same logs.`
    + (without.length ? ` Without a common run: ${without.join(", ")}.` : "")));
}

function ratios(t, m, other, metric) {
  const failed = (row) => !["ok", "skipped"].includes(runs.status[row]);
  const value = (row) => (failed(row) ? Infinity : runs[metric][row]);
  const base = new Map((tasks[t].runs[other] ?? []).map((row) => [runs.seed[row], value(row)]));
  return (tasks[t].runs[m] ?? []).map((row) => [value(row), base.get(runs.seed[row])])
    .filter(([own, theirs]) => own !== null && own !== undefined && finite(theirs) && theirs > 0).map(([own, theirs]) => own / theirs);
}

function median(values) {
  const sorted = [...values].sort((a, b) => a - b), n = sorted.length;
  return n % 2 ? sorted[n >> 1] : sorted[n / 2 - 1] === sorted[n / 2] ? sorted[n / 2] : (sorted[n / 2 - 1] + sorted[n / 2]) / 2;
}

// ---- every task at a glance

function drawMatrix() {
  const metric = question().metric, order = board().standings.map((s) => s.contestant), group = board().tasks;
  const scores = data.scores[state.question];
  const headings = group.map((t) => element("th", {scope: "col", class: "turned", title: tasks[t].title},
    element("button", {type: "button", onclick: () => chooseTask(t, true)}, element("span", {}, tasks[t].name))));
  const scales = Object.fromEntries(group.map((t) => [t, scaleFor(Object.values(tasks[t].cells).map((c) => c[metric]?.[0] ?? null), unitOf(metric, t))]));
  const rows = order.map((m) => element("tr", {}, nameCell(m), ...group.map((t) => {
    const value = tasks[t].cells[m]?.[metric]?.[0] ?? null, lost = tasks[t].lost[m] ?? [0, 0], share = scores[m][t];
    const text = value !== null ? number(value * scales[t][0], 2) : lost[0] ? "✕" : lost[1] ? "skip" : "";
    const tone = finite(share) && value !== null ? Math.max(0, Math.min(1, share)) : null;
    const style = tone === null ? null : `background:${shade(tone)};color:${tone > 0.62 ? "#fff" : "#1a1a1a"}`;
    return element("td", {class: lost[0] && value === null ? "n lost" : "n", style, "data-v": value ?? "", title: `${contestants[m].name}, ${tasks[t].name}: score ${number(share)}`},
      text ? element("button", {type: "button", class: "number", onclick: () => showRuns(t, m)}, text, lost[0] && value !== null ? element("sup", {}, "✕") : null) : "");
  })));
  const floorRow = element("tr", {"data-fixed": "1", class: "fixed"}, element("th", {scope: "row", class: "name"}, "noise floor"),
    ...group.map((t) => element("td", {class: "n"}, metric in tasks[t].floors ? number(tasks[t].floors[metric] * scales[t][0], 2) : "–")));
  const unitRow = element("tr", {"data-fixed": "1", class: "fixed"}, element("th", {scope: "row", class: "name"}, "unit"), ...group.map((t) => element("td", {class: "n soft"}, scales[t][1] || "–")));
  byId("matrix").replaceChildren(element("div", {class: "scroll tall"}, element("table", {class: "matrix"},
    element("thead", {}, element("tr", {}, element("th", {scope: "col", class: "name"}, "Median over seeds"), ...headings)), element("tbody", {}, ...rows, floorRow, unitRow))));
}

const shade = (s) => `rgb(${[255 - 255 * s, 255 - 141 * s, 255 - 77 * s].map(Math.round).join(",")})`;

// ---- one task

function drawTask() {
  const t = state.task, task = tasks[t];
  byId("task-title").textContent = task.title;
  byId("task-tags").replaceChildren(...task.tags.map((tag) => element("span", {class: "tag"}, tag)));
  drawCurves(t);
  const names = task.metrics, scales = Object.fromEntries(names.map((n) => [n, scaleFor(Object.values(task.cells).map((c) => c[n]?.[0] ?? null), unitOf(n, t))]));
  const key = names.includes(question().metric) ? question().metric : names[0];
  const merit = (m) => task.cells[m]?.[key]?.[0] ?? Infinity;
  const order = Object.keys(task.runs).map(Number).sort((a, b) => (merit(a) > merit(b)) - (merit(a) < merit(b)));
  const rows = order.map((m) => element("tr", {class: contestants[m].role}, nameCell(m),
    element("td", {class: task.lost[m][0] ? "n warn" : "n"}, element("button", {type: "button", class: "number", onclick: () => showRuns(t, m)}, runsText(t, m))), ...names.map((n) => taskCell(t, m, n, scales[n][0]))));
  const floorRow = element("tr", {"data-fixed": "1", class: "fixed"}, element("th", {scope: "row", class: "name"}, "noise floor"), element("td", {}),
    ...names.map((n) => element("td", {class: "n"}, n in task.floors ? number(task.floors[n] * scales[n][0]) : "–")));
  const published = task.published.map((p) => element("tr", {"data-fixed": "1", class: "fixed published"}, element("th", {scope: "row", class: "name", title: p.source}, p.label, " ", element("span", {class: "role"}, "published")), element("td", {}),
    ...names.map((n) => element("td", {class: "n"}, n === p.metric ? number(p.value * scales[n][0]) : ""))));
  const table = element("table", {}, head("Contestant", ["Runs", "Seeds, and those without a result"], ...names.map((n) => [`${metrics[n].title}${scales[n][1] ? ` (${scales[n][1]})` : ""}`, metrics[n].meaning])), element("tbody", {}, ...rows, floorRow, ...published));
  sortable(table);
  byId("task-table").replaceChildren(element("div", {class: "scroll"}, table));
}

function runsText(t, m) {
  const [failed, skipped] = tasks[t].lost[m], total = tasks[t].runs[m].length;
  return failed ? `${failed} of ${total} failed` : skipped ? `${skipped} of ${total} skipped` : String(total);
}

function taskCell(t, m, name, factor) {
  const found = tasks[t].cells[m]?.[name];
  if (!found) return element("td", {class: "n soft", "data-v": ""}, "–");
  const spread = found[1] !== found[2] ? `${number(found[1] * factor, 2)} – ${number(found[2] * factor, 2)}` : "";
  return element("td", {class: "n", "data-v": found[0]}, element("button", {type: "button", class: "number", onclick: () => showRuns(t, m)}, number(found[0] * factor)), spread ? element("small", {}, spread) : null);
}

function drawCurves(t) {
  const place = byId("curves"), task = tasks[t], present = Object.keys(task.curves).map(Number), width = place.clientWidth;
  if (!present.length) { byId("curve-choice").replaceChildren(); return place.replaceChildren(element("p", {class: "note"}, "No contestant was simulated on this task.")); }
  const end = (m) => task.curves[m].median.at(-1);
  const ranked = present.filter((m) => !contestants[m].role).sort((a, b) => (end(a) > end(b)) - (end(a) < end(b)));
  const chosen = state.curves ?? [...new Set([...ranked.slice(0, 4), ...(ranked.includes(data.baseline) ? [data.baseline] : [])])];
  const colour = (m) => COLOURS[chosen.indexOf(m) % COLOURS.length], dash = (m) => DASHES[chosen.indexOf(m) % DASHES.length];
  byId("curve-choice").replaceChildren(...ranked.map((m) => {
    const on = chosen.includes(m);
    return element("button", {type: "button", class: on ? "chip on" : "chip", "aria-pressed": String(on), style: on ? `border-color:${colour(m)};color:${colour(m)}` : null,
      onclick: () => { state.curves = on ? chosen.filter((o) => o !== m) : [...chosen, m].slice(-COLOURS.length); drawCurves(t); }}, contestants[m].name);
  }));
  const unit = unitOf("simulation_error", t), all = present.flatMap((m) => task.curves[m].median).filter((v) => finite(v) && v > 0);
  if (!all.length) return place.replaceChildren(element("p", {class: "note"}, "No free run stayed finite."));
  const noise = task.floors.simulation_error ?? null, [factor, shown] = scaleFor(all, unit);
  const height = Math.min(420, Math.max(280, 0.5 * width)), frame = {left: 60, right: width - 10, top: 10, bottom: height - 44}, svg = canvas(width, height, "error against horizon");
  const h = task.curves[present[0]].horizon, low = Math.min(...all, ...(noise ? [noise] : [])) * factor, high = Math.max(...all) * factor;
  const x = scale(Math.min(...h), Math.max(...h), frame.left, frame.right, true), y = scale(low / 1.4, high * 1.4, frame.bottom, frame.top, true);
  axes(svg, frame, x, y, "Horizon of the free run (s)", `Position error (${shown})`);
  const path = (c, values) => "M" + (values.some((v) => finite(v) && v > 0) ? "" : "0,0") + values.map((v, k) => [c.horizon[k], v]).filter(([, v]) => finite(v) && v > 0).map(([a, v]) => `${x.at(a)},${y.at(v * factor)}`).join("L");
  const labels = [];
  const drawn = (m, attributes) => titled(shape("path", {d: path(task.curves[m], task.curves[m].median), fill: "none", ...attributes}), contestants[m].name);
  if (noise) {
    svg.append(shape("line", {x1: frame.left, x2: frame.right, y1: y.at(noise * factor), y2: y.at(noise * factor), class: "noise"}));
    labels.push(shape("text", {x: frame.left + 6, y: y.at(noise * factor) - 5, class: "tick"}, "noise floor over whole logs"));
  }
  for (const m of ranked.filter((m) => !chosen.includes(m))) svg.append(drawn(m, {class: "faint"}));
  for (const m of present.filter((m) => contestants[m].role)) {
    svg.append(drawn(m, {class: "bound"}));
    const last = task.curves[m].median.findLastIndex((v) => finite(v) && v > 0);
    if (last >= 0) labels.push(shape("text", {x: x.at(task.curves[m].horizon[last]) - 4, y: Math.max(frame.top + 12, y.at(task.curves[m].median[last] * factor) - 6), "text-anchor": "end", class: "tick"}, contestants[m].name));
  }
  for (const m of chosen.filter((m) => present.includes(m))) {
    const c = task.curves[m], inside = c.horizon.map((a, k) => [a, c.low[k], c.high[k]]).filter((p) => finite(p[1]) && finite(p[2]) && p[1] > 0);
    if (inside.length > 1) svg.append(shape("path", {d: "M" + [...inside.map((p) => `${x.at(p[0])},${y.at(p[1] * factor)}`), ...inside.reverse().map((p) => `${x.at(p[0])},${y.at(Math.min(p[2] * factor, y.high))}`)].join("L") + "Z", fill: colour(m), opacity: 0.1}));
    svg.append(drawn(m, {stroke: colour(m), "stroke-width": 2.2, "stroke-dasharray": dash(m)}));
  }
  svg.append(...labels);
  place.replaceChildren(svg);
}

function chooseTask(t, jump = false) {
  state.task = t;
  byId("task").value = String(t);
  drawTask();
  if (jump) byId("one-task").scrollIntoView();
}

// ---- who beats whom

function drawWins() {
  const table = data.wins[state.question], order = data.boards.find((b) => b.question === state.question && b.group === "all").standings.map((s) => s.contestant);
  const rows = order.map((m) => element("tr", {}, nameCell(m), ...order.map((o) => {
    const p = table[m][o];
    if (m === o || !finite(p)) return element("td", {class: "n soft"}, m === o ? "" : "–");
    return element("td", {class: "n", style: `background:${diverging(p)}`, title: `${contestants[m].name} beats ${contestants[o].name} in ${percent(p)} of the common runs`}, String(Math.round(100 * p)));
  })));
  byId("wins").replaceChildren(element("div", {class: "scroll tall"}, element("table", {class: "matrix"},
    element("thead", {}, element("tr", {}, element("th", {scope: "col", class: "name"}, "Beats (%)"), ...order.map((o) => element("th", {scope: "col", class: "turned"}, element("span", {}, contestants[o].name))))), element("tbody", {}, ...rows))));
}

const diverging = (p) => (p >= 0.5 ? `rgba(0,114,178,${(1.1 * (p - 0.5)).toFixed(3)})` : `rgba(213,94,0,${(1.1 * (0.5 - p)).toFixed(3)})`);

// ---- naming

function drawNaming() {
  const place = byId("naming");
  if (!place) return;
  const names = [...new Set(data.naming.map((n) => n.contestant))];
  state.namer ??= names[0];
  const own = data.naming.filter((n) => n.contestant === state.namer), columns = [...new Set(own.flatMap((n) => n.named.map(([cause]) => cause)))].sort();
  const rows = own.map((n) => {
    const named = new Map(n.named);
    return element("tr", {}, element("th", {scope: "row", class: "name"}, breakable(n.task)), ...columns.map((c) => {
      const share = (named.get(c) ?? 0) / n.runs;
      return element("td", {class: "n", style: share ? `background:${shade(0.15 + 0.75 * share)};color:${share > 0.62 ? "#fff" : "#1a1a1a"}` : null}, share ? `${named.get(c)}` : "");
    }), element("td", {class: "n"}, String(n.runs)), element("td", {class: "n"}, number(n.score, 2)), element("td", {}, n.outcomes.map(([o, count]) => `${o} ${count}`).join(", ")));
  });
  const mean = own.reduce((sum, n) => sum + n.score * n.runs, 0) / own.reduce((sum, n) => sum + n.runs, 0);
  place.replaceChildren(names.length > 1 ? picker("namer", names.map((n) => [n, n]), state.namer, (v) => { state.namer = v; drawNaming(); }, "Contestant") : "",
    element("div", {class: "scroll tall"}, element("table", {class: "matrix"}, element("thead", {}, element("tr", {}, element("th", {scope: "col", class: "name"}, "Hidden in task"),
      ...columns.map((c) => element("th", {scope: "col", class: "turned"}, element("span", {}, c))), ...["Runs", "Score"].map((c) => element("th", {scope: "col", class: "n"}, c)), element("th", {scope: "col"}, "Judged"))), element("tbody", {}, ...rows))),
    element("p", {class: "note"}, `${state.namer} scores ${number(mean, 2)} over ${plural(own.reduce((sum, n) => sum + n.runs, 0), "run")}. Counts say in how many runs a cause was named.`));
}

// ---- where a number comes from

function showRuns(t, m) {
  const task = tasks[t], rows = task.runs[m], names = task.metrics.filter((n) => rows.some((row) => runs[n]?.[row] !== null && runs[n]?.[row] !== undefined));
  const table = element("table", {}, head("Seed", "Status", "Fingerprint", ["Made by", ""], ...names.map((n) => [metrics[n].title, metrics[n].meaning])),
    element("tbody", {}, ...rows.map((row) => element("tr", {}, element("td", {class: "n"}, String(runs.seed[row])),
      element("td", {class: runs.status[row] === "ok" ? "" : "warn"}, runs.status[row] + (runs.reason[row] ? `: ${runs.reason[row]}` : "")),
      element("td", {}, element("code", {class: "mark"}, runs.fingerprint[row])), element("td", {class: "n"}, `№ ${runs.maker[row] + 1}`),
      ...names.map((n) => element("td", {class: "n"}, quantity(runs[n][row], unitOf(n, t), 4)))))));
  const makers = [...new Set(rows.map((row) => runs.maker[row]))].map((k) => element("p", {class: "note"}, `№ ${k + 1}: ` + data.provenance.columns.map((c, i) => `${c} ${data.provenance.makers[k][i] || "unknown"}`).join(", ")));
  byId("runs").replaceChildren(element("form", {method: "dialog"}, element("button", {class: "close", "aria-label": "close"}, "✕")),
    element("h3", {}, `${contestants[m].name} on ${task.name}`), element("p", {class: "note"}, element("code", {}, contestants[m].key)), element("div", {class: "scroll"}, table), ...makers);
  byId("runs").showModal();
}

// ---- choices

function picker(id, options, value, change, label) {
  return element("label", {for: id}, `${label} `, element("select", {id, onchange: (event) => change(event.target.value)},
    ...options.map(([v, text]) => element("option", {value: v, selected: String(v) === String(value)}, text))));
}

function contestantOptions() {
  return contestants.map((c, m) => [m, c.name]);
}

function drawAll() {
  for (const button of document.querySelectorAll("[data-question]")) button.setAttribute("aria-pressed", String(button.dataset.question === state.question));
  const first = board().standings.find((s) => !contestants[s.contestant].role && s.contestant !== state.against);
  state.contestant ??= first ? first.contestant : 0;
  drawStandings(); drawCost(); drawImprovement(); drawMatrix(); drawTask(); drawWins(); drawNaming();
}

function start() {
  for (const button of document.querySelectorAll("[data-question]")) button.addEventListener("click", () => { state.question = button.dataset.question; drawAll(); });
  const seen = [...new Set(data.boards.map((b) => b.group))];
  byId("group-choice").replaceChildren(picker("group", seen.map((g) => [g, `${g} (${data.boards.find((b) => b.group === g).tasks.length})`]), state.group, (v) => { state.group = v; drawAll(); }, "Tasks"));
  byId("cost-choice").replaceChildren(picker("cost-axis", Object.entries(COSTS), state.cost, (v) => { state.cost = v; drawCost(); }, "Cost"));
  drawChoices();
  byId("task-choice").replaceChildren(picker("task", tasks.map((task, t) => [t, task.name]), state.task, (v) => { state.curves = null; chooseTask(Number(v)); }, "Task"));
  let before = window.innerWidth, waiting = 0;
  window.addEventListener("resize", () => {
    if (window.innerWidth === before) return;
    before = window.innerWidth;
    window.clearTimeout(waiting);
    waiting = window.setTimeout(() => { drawCost(); drawImprovement(); drawCurves(state.task); }, 120);
  });
  for (const table of document.querySelectorAll("table.plain")) sortable(table);
  drawAll();
  drawChoices();
}

function drawChoices() {
  byId("improvement-choice").replaceChildren(
    picker("contestant", contestantOptions(), state.contestant ?? 0, (v) => { state.contestant = Number(v); drawImprovement(); }, "Contestant"), " ",
    picker("against", contestantOptions(), state.against, (v) => { state.against = Number(v); drawImprovement(); }, "against"));
}

start();
