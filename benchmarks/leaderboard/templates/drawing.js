"use strict";
// Numbers as people read them, and the few kinds of drawing that the page needs.

const COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#B8860B", "#3A9BD9", "#7A4FB5"];
const DASHES = ["", "7 3", "2 3", "9 3 2 3", "", "7 3", "2 3"];
const PREFIXES = {6: "M", 3: "k", 0: "", "-3": "m", "-6": "µ", "-9": "n"};
const PREFIXED = ["rad", "m", "s", "V", "A", "N", "N m", "Hz"];
const superscript = (text) => text.replace(/[-0-9]/g, (c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]);
const finite = (v) => v !== null && v !== undefined && Number.isFinite(v);

function number(value, digits = 3) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (!Number.isFinite(value)) return value > 0 ? "∞" : "−∞";
  if (value === 0) return "0";
  const power = Math.floor(Math.log10(Math.abs(Number(value.toExponential(digits - 1)))));
  if (power >= -4 && power < Math.max(digits + 2, 5)) return value.toFixed(Math.max(digits - 1 - power, 0)).replace("-", "−");
  return (value / 10 ** power).toFixed(digits - 1).replace("-", "−") + " × 10" + superscript(String(power));
}

// Factor and unit in which the middle one of the values has one to three digits before the point.
function scaleFor(values, unit) {
  const known = values.filter((v) => finite(v) && v !== 0).map(Math.abs).sort((a, b) => a - b);
  if (!known.length || !PREFIXED.includes(unit)) return [1, unit === "1" ? "" : unit];
  const power = Math.min(Math.max(3 * Math.floor(Math.log10(known[known.length >> 1]) / 3 + 1e-9), -9), 6);
  return [10 ** -power, PREFIXES[power] + unit];
}

const quantity = (value, unit, digits = 3) => {
  if (!finite(value)) return number(value);
  const [factor, scaled] = scaleFor([value], unit);
  return scaled ? `${number(value * factor, digits)} ${scaled}` : number(value, digits);
};

function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (value !== null && value !== undefined && value !== false) made.setAttribute(key, value === true ? "" : value);
  }
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

function shape(name, attributes = {}, text = null) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) if (value !== null && value !== "") made.setAttribute(key, value);
  if (text !== null) made.textContent = text;
  return made;
}

const titled = (node, text) => { node.append(shape("title", {}, text)); return node; };

function canvas(width, height, label) {
  return shape("svg", {width, height, viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": label});
}

// A scale from data to pixels with its ticks; logarithmic ones have decades, and halves where there is room.
function scale(low, high, from, to, logarithmic) {
  const f = logarithmic ? Math.log10 : (v) => v;
  if (!(f(high) > f(low))) [low, high] = logarithmic ? [low / 2, high * 2] : [low - 0.5, high + 0.5];
  const at = (v) => from + (to - from) * (f(v) - f(low)) / (f(high) - f(low));
  return {at, ticks: logarithmic ? decades(low, high, Math.abs(to - from)) : steps(low, high, Math.abs(to - from)), low, high};
}

function decades(low, high, room) {
  const first = Math.floor(Math.log10(low)), last = Math.ceil(Math.log10(high)), wide = room / (last - first);
  const parts = wide > 110 ? [1, 2, 5] : wide > 70 ? [1, 3] : [1], every = Math.max(1, Math.ceil(45 / wide)), found = [];
  for (let power = first; power <= last; power++)
    if (parts.length > 1 || power % every === 0) for (const part of parts) found.push(part * 10 ** power);
  return found.filter((v) => v >= low * 0.999 && v <= high * 1.001);
}

function steps(low, high, room) {
  const raw = (high - low) / Math.max(2, Math.floor(room / 60)), power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((s) => s * power).find((s) => s >= raw), found = [];
  for (let v = Math.ceil(low / step - 1e-9) * step; v <= high + 1e-9 * step; v += step) found.push(Math.abs(v) < 1e-12 ? 0 : v);
  return found;
}

// Axes around a frame: ticks, light grid, and titles that carry the unit.
function axes(svg, frame, x, y, titleX, titleY) {
  const {left, right, top, bottom} = frame, size = 12;
  for (const tick of x.ticks) {
    svg.append(shape("line", {x1: x.at(tick), x2: x.at(tick), y1: top, y2: bottom, class: "grid"}));
    svg.append(shape("text", {x: x.at(tick), y: bottom + 16, "text-anchor": "middle", class: "tick"}, brief(tick)));
  }
  for (const tick of y.ticks) {
    svg.append(shape("line", {x1: left, x2: right, y1: y.at(tick), y2: y.at(tick), class: "grid"}));
    svg.append(shape("text", {x: left - 6, y: y.at(tick) + 4, "text-anchor": "end", class: "tick"}, brief(tick)));
  }
  svg.append(shape("rect", {x: left, y: top, width: right - left, height: bottom - top, class: "frame"}));
  svg.append(shape("text", {x: (left + right) / 2, y: bottom + 36, "text-anchor": "middle", class: "axis"}, titleX));
  svg.append(shape("text", {x: size, y: (top + bottom) / 2, "text-anchor": "middle", class: "axis",
    transform: `rotate(-90 ${size} ${(top + bottom) / 2})`}, titleY));
}

const brief = (v) => (v !== 0 && (Math.abs(v) < 0.001 || Math.abs(v) >= 10000) ? power(v) : String(Number(v.toPrecision(3))).replace("-", "−"));
const power = (v) => {
  const exponent = Math.floor(Math.log10(Math.abs(v)) + 1e-9), factor = Number((v / 10 ** exponent).toPrecision(2));
  return (factor === 1 ? "" : `${factor}·`) + "10" + superscript(String(exponent));
};

// Places labels beside points where they hide nothing; those without room are left to the tooltip.
function placeLabels(svg, points, frame) {
  const taken = points.map((p) => [p.x - 6, p.y - 6, p.x + 6, p.y + 6]);
  const free = (box) => box[0] >= frame.left && box[2] <= frame.right && box[1] >= frame.top && box[3] <= frame.bottom
    && !taken.some((t) => box[0] < t[2] && t[0] < box[2] && box[1] < t[3] && t[1] < box[3]);
  for (const p of points) {
    const width = 6.3 * p.label.length;
    for (const [dx, dy, anchor] of [[9, 4, "start"], [-9, 4, "end"], [0, -10, "middle"], [0, 18, "middle"],
                                    [9, -8, "start"], [9, 16, "start"], [-9, -8, "end"], [-9, 16, "end"]]) {
      const x = p.x + dx, start = anchor === "start" ? x : anchor === "end" ? x - width : x - width / 2;
      const box = [start, p.y + dy - 10, start + width, p.y + dy + 3];
      if (free(box)) {
        taken.push(box);
        svg.append(shape("text", {x, y: p.y + dy, "text-anchor": anchor, class: "label"}, p.label));
        break;
      }
    }
  }
}

// Tables are sorted by a click on a heading; cells carry their value, unknown ones stay last.
function sortable(table) {
  [...table.tHead.rows[0].cells].forEach((head, column) => {
    if (!head.textContent.trim()) return;
    const button = element("button", {type: "button", class: "sort"}, ...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const down = head.getAttribute("aria-sort") === "ascending";
      for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
      const body = table.tBodies[0], fixed = [...body.rows].filter((row) => row.dataset.fixed);
      const value = (row) => row.cells[column]?.dataset.v ?? row.cells[column]?.textContent ?? "";
      const moving = [...body.rows].filter((row) => !row.dataset.fixed).sort((a, b) => compare(value(a), value(b), down));
      body.append(...moving, ...fixed);
    });
  });
}

function compare(a, b, down) {
  const [x, y] = [Number(a), Number(b)], unknown = (text, v) => text === "" || text === "–" || Number.isNaN(v);
  if (a !== "" && b !== "" && !Number.isNaN(x) && !Number.isNaN(y)) return down ? y - x : x - y;
  if (unknown(a, x) !== unknown(b, y)) return unknown(a, x) ? 1 : -1;
  return down ? b.localeCompare(a) : a.localeCompare(b);
}
