// Looking closer: details of an object on hover and click, zoom and pan.
const NEAR = 10, CLOSEST = 0.2;

function viewOf(s) { return s.view[now.world ? "world" : "sensor"]; }

// The row of the object at a pixel of the scene, the smallest where there are several; -1 for none.
function pick(u, v) {
  const s = streams[now.stream], canvas = get("scene"), frame = frameOf(s, now.k, now.world);
  const p = projection(viewOf(s), canvas.clientWidth, canvas.clientHeight);
  let best = -1, least = Infinity;
  for (const j of frame.known ? members(s, now.k) : []) {
    const box = corners(s, j).map(([x, y]) => { const [a, b] = frame.beam(x, y); return [p.X(a), p.Y(b)]; });
    const away = distance(box, u, v), size = s.box_length[j] * s.box_width[j];
    const rank = away > 0 ? 1e12 + away : size;
    if (away <= NEAR && rank < least) { best = j; least = rank; }
  }
  return best;
}

// From a point to a box [pixels]; 0 inside.
function distance(box, u, v) {
  let within = false, least = Infinity;
  box.forEach(([c, d], i) => {
    const [a, b] = box[(i + 3) % 4], long = (c - a) ** 2 + (d - b) ** 2;
    const t = long ? Math.min(1, Math.max(0, ((u - a) * (c - a) + (v - b) * (d - b)) / long)) : 0;
    least = Math.min(least, Math.hypot(u - a - t * (c - a), v - b - t * (d - b)));
    if ((b > v) !== (d > v) && u < a + (v - b) / (d - b) * (c - a)) within = !within;
  });
  return within ? 0 : least;
}

// Who is chosen stays so from sweep to sweep: by its track, or else by its number.
function choose(j) {
  const s = streams[now.stream];
  now.chosen = j < 0 ? null : s.tracks && s.tracks.track[j] > 0 ? { track: s.tracks.track[j] } : { object: s.object[j] };
}

function chosenRow(s, k) {
  if (!now.chosen) return -1;
  const found = members(s, k).find((j) => (now.chosen.track ? s.tracks && s.tracks.track[j] === now.chosen.track : s.object[j] === now.chosen.object));
  return found === undefined ? -1 : found;
}

function listed(into, entries) {
  into.replaceChildren(...entries.map(([name, value]) => {
    const pair = document.createElement("div"), term = document.createElement("dt"), told = document.createElement("dd");
    term.append(name); told.append(value); pair.append(term, told);
    return pair;
  }));
}

function showDetails(s, k) {
  const j = chosenRow(s, k), gone = now.chosen && j < 0;
  listed(get("details"), j >= 0 ? detailsOf(s, j) : []);
  get("hint").hidden = j >= 0;
  get("hint").textContent = gone ? "The chosen one is not seen in this sweep." : "Point at a box for its numbers; click keeps them.";
}

function hover(event) {
  const box = get("scene").getBoundingClientRect(), u = event.clientX - box.left, v = event.clientY - box.top, tip = get("tip");
  const j = event.pointerType === "touch" ? -1 : pick(u, v);
  tip.hidden = j < 0;
  get("scene").classList.toggle("over", j >= 0);
  if (j < 0) return;
  listed(tip, detailsOf(streams[now.stream], j));
  tip.style.left = Math.max(0, u + 14 + tip.offsetWidth > box.width ? u - 14 - tip.offsetWidth : u + 14) + "px";
  tip.style.top = Math.max(0, Math.min(v + 14, box.height - tip.offsetHeight)) + "px";
}

// Zoom by a factor around a pixel of the scene, or around its middle.
function zoom(factor, u, v) {
  const s = streams[now.stream], canvas = get("scene"), view = viewOf(s), whole = s.whole[now.world ? "world" : "sensor"];
  const p = projection(view, canvas.clientWidth, canvas.clientHeight);
  const x = u === undefined ? view.x : p.x(u), y = v === undefined ? view.y : p.y(v);
  const by = Math.min(Math.max(factor, CLOSEST / Math.max(view.width, view.height)), Math.max(1, 2 * whole.width / view.width));
  view.x = x + (view.x - x) * by; view.y = y + (view.y - y) * by; view.width *= by; view.height *= by;
  show();
}

function pan(du, dv) {
  const canvas = get("scene"), view = viewOf(streams[now.stream]), p = projection(view, canvas.clientWidth, canvas.clientHeight);
  view.x -= du / p.scale; view.y += dv / p.scale;
  show();
}

function unzoom() {
  const s = streams[now.stream], name = now.world ? "world" : "sensor";
  s.view[name] = { ...s.whole[name] };
  show();
}

function isZoomed() { return viewOf(streams[now.stream]).width < streams[now.stream].whole[now.world ? "world" : "sensor"].width * 0.999; }

function startLooking() {
  const canvas = get("scene"), fingers = new Map();
  let moved = 0;
  canvas.addEventListener("pointerdown", (event) => {
    if (event.button) return;
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, event);
    moved = 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) { hover(event); return; }
    const box = canvas.getBoundingClientRect(), others = [...fingers.values()].filter((one) => one.pointerId !== event.pointerId);
    const du = event.clientX - before.clientX, dv = event.clientY - before.clientY;
    moved += Math.hypot(du, dv);
    fingers.set(event.pointerId, event);
    get("tip").hidden = true;
    if (others.length) {
      const apart = (one) => Math.hypot(one.clientX - others[0].clientX, one.clientY - others[0].clientY) || 1;
      zoom(apart(before) / apart(event), (event.clientX + others[0].clientX) / 2 - box.left, (event.clientY + others[0].clientY) / 2 - box.top);
    } else if (event.pointerType !== "touch" || isZoomed()) pan(du, dv);
  });
  const lift = (event) => {
    if (fingers.delete(event.pointerId) && event.type === "pointerup" && moved < 5 && !fingers.size) {
      const box = canvas.getBoundingClientRect();
      choose(pick(event.clientX - box.left, event.clientY - box.top));
      moveTo(now.k);
    }
  };
  canvas.addEventListener("pointerup", lift);
  canvas.addEventListener("pointercancel", lift);
  canvas.addEventListener("pointerleave", () => { get("tip").hidden = true; });
  // Who scrolls through the page is not held up: the wheel zooms with Ctrl, or once the scene has been clicked.
  canvas.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && document.activeElement !== canvas) return;
    event.preventDefault();
    const box = canvas.getBoundingClientRect();
    zoom(Math.exp(Math.max(-0.5, Math.min(0.5, event.deltaY * 0.002))), event.clientX - box.left, event.clientY - box.top);
  }, { passive: false });
  get("closer").addEventListener("click", () => zoom(0.7));
  get("farther").addEventListener("click", () => zoom(1 / 0.7));
  get("fit").addEventListener("click", unzoom);
  get("world").addEventListener("change", () => { now.world = get("world").value === "world"; show(); });
}
