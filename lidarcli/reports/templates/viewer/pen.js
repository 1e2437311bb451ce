// What is drawn with: colours of the page, a pen for the screen, and one that writes SVG.
const FONT = "11px system-ui, sans-serif", BOLD = "bold 12px system-ui, sans-serif";

// The colours of the page as it is shown, or those for paper, which are light.
function coloursOf(paper) {
  const style = getComputedStyle(paper ? get("paper") : document.documentElement);
  const told = (name) => style.getPropertyValue("--" + name).trim();
  const found = { shapes: data.shapes.map((name) => told("shape-" + name)), zone: (action) => told("zone-" + action) };
  for (const name of ["ink", "quiet", "grid", "paper", "blue", "vermilion", "green", "grey", "dark", "light", "raised", "yellow", "orange", "shade", "bar-objects", "bar-agents", "sky", "purple", "heat-1", "heat-2", "heat-3", "heat-4", "heat-5"]) {
    found[name] = told(name);
  }
  return found;
}

function open(id) {
  const canvas = get(id), ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
  if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = FONT;
  return { pen: pen, width: width, height: height, ratio: ratio };
}

// A pen with the part of the canvas' methods that the drawings need; `text()` is the file.
function svgPen(width, height) {
  const out = [], round = (value) => Math.round(value * 100) / 100;
  const safe = (text) => String(text).replace(/[&<>"]/g, (mark) => "&#" + mark.charCodeAt(0) + ";").replace(/[\u0000-\u001f]/g, " ");
  let path = "", dash = "", groups = 0, clips = 0;
  const written = (x, y, text, paint) => {
    const anchor = { center: "middle", right: "end" }[pen.textAlign] || "start", shift = pen.textBaseline === "middle" ? ' dy="0.35em"' : "";
    out.push(`<text x="${round(x)}" y="${round(y)}"${shift} text-anchor="${anchor}" style="font: ${pen.font}" ${paint}>${safe(text)}</text>`);
  };
  const pen = {
    strokeStyle: "#000", fillStyle: "#000", lineWidth: 1, font: FONT, textAlign: "start", textBaseline: "alphabetic", lineJoin: "miter",
    beginPath() { path = ""; },
    moveTo(x, y) { path += `M${round(x)} ${round(y)}`; },
    lineTo(x, y) { path += `L${round(x)} ${round(y)}`; },
    closePath() { path += "Z"; },
    rect(x, y, w, h) { path += `M${round(x)} ${round(y)}h${round(w)}v${round(h)}h${round(-w)}Z`; },
    arc(x, y, r) { path += `M${round(x - r)} ${round(y)}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0`; },
    stroke() { out.push(`<path d="${path}" fill="none" stroke="${pen.strokeStyle}" stroke-width="${pen.lineWidth}"${dash}/>`); },
    fill() { out.push(`<path d="${path}" fill="${pen.fillStyle}"/>`); },
    fillRect(x, y, w, h) { pen.beginPath(); pen.rect(x, y, w, h); pen.fill(); },
    fillText(text, x, y) { written(x, y, text, `fill="${pen.fillStyle}"`); },
    strokeText(text, x, y) { written(x, y, text, `fill="none" stroke="${pen.strokeStyle}" stroke-width="${pen.lineWidth}" stroke-linejoin="round"`); },
    setLineDash(parts) { dash = parts.length ? ` stroke-dasharray="${parts.join(" ")}"` : ""; },
    save() {},
    clip() { clips++; groups++; out.push(`<clipPath id="clip${clips}"><path d="${path}"/></clipPath><g clip-path="url(#clip${clips})">`); },
    restore() { if (groups) { groups--; out.push("</g>"); } },
    text() { return `<svg xmlns="http://www.w3.org/2000/svg" width="${width}" height="${height}" viewBox="0 0 ${width} ${height}">\n${out.join("\n")}\n</svg>\n`; },
  };
  return pen;
}

function line(pen, a, b, c, d) { pen.beginPath(); pen.moveTo(a, b); pen.lineTo(c, d); pen.stroke(); }
function dot(pen, x, y, r) { pen.beginPath(); pen.arc(x, y, r, 0, TURN); pen.fill(); }

function polygon(pen, points) {
  pen.beginPath();
  points.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
  pen.closePath();
}

function arrow(pen, a, b, c, d) {
  const length = Math.hypot(c - a, d - b);
  if (length < 2) return;
  const x = (c - a) / length, y = (d - b) / length, head = Math.min(7, length);
  line(pen, a, b, c, d);
  line(pen, c, d, c - head * (x + 0.5 * y), d - head * (y - 0.5 * x));
  line(pen, c, d, c - head * (x - 0.5 * y), d - head * (y + 0.5 * x));
}

// Bold words with a seam of the ground around them.
function word(pen, text, x, y, colour, ground) {
  pen.textAlign = "center"; pen.textBaseline = "middle"; pen.font = BOLD;
  pen.strokeStyle = ground; pen.lineWidth = 3; pen.lineJoin = "round"; pen.strokeText(text, x, y);
  pen.fillStyle = colour; pen.fillText(text, x, y);
  pen.textAlign = "start"; pen.textBaseline = "alphabetic"; pen.font = FONT;
}

// Names where they are wanted, or around (u, v), what they name, where no other is; a line leads from one that stands apart.
function drawNames(pen, names, ground) {
  const taken = names.reduce((others, one) => {
    const half = 4.2 * one.text.length + 1, places = [[one.x, one.y]];
    for (const r of [14, 22, 32, 44]) for (let n = 0; n < 12; n++) places.push([one.u + (r + half) * Math.cos(n * TURN / 12), one.v + r * Math.sin(n * TURN / 12)]);
    const [x, y] = places.find(([x, y]) => others.every((other) => Math.abs(x - other.x) >= half + other.half || Math.abs(y - other.y) >= 14)) || places[0];
    if (Math.hypot(Math.max(0, Math.abs(x - one.u) - half), y - one.v) > 16) { pen.strokeStyle = one.colour; pen.lineWidth = 0.8; line(pen, one.u, one.v, x, y); }
    return [...others, { ...one, x: x, y: y, half: half }];
  }, []);
  for (const one of taken) word(pen, one.text, one.x, one.y, one.colour, ground);
}

// Round numbers from low to high, at most so many, each with its text.
function ticks(low, high, most) {
  const raw = (high - low) / Math.max(most, 1), power = Math.pow(10, Math.floor(Math.log10(raw)));
  const step = ([1, 2, 5, 10].find((m) => m * power >= raw * (1 - 1e-9)) || 10) * power, found = [];
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + step * 1e-9; i++) found.push([i * step, (i * step || 0).toFixed(Math.min(digits, 20))]);
  return found;
}
