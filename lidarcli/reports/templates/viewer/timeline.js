// The time line: objects per sweep, the agents among them on top, under the slider of the sweeps, in its scale.
const THUMB = 16, BASE = 40;

function timeScale(s, width) {
  const step = s.count > 1 ? (width - THUMB) / (s.count - 1) : 0;
  return { step: step, X: (k) => THUMB / 2 + k * step, k: (x) => (step ? Math.round((x - THUMB / 2) / step) : 0) };
}

function drawTimeline(s, k, colours) {
  const { pen, width, height } = open("timeline"), { step, X } = timeScale(s, width);
  const most = s.objects.reduce((high, value) => Math.max(high, value), 1), room = BASE - 12;
  const edge = (i) => Math.floor(X(i) - Math.max(step, 1) / 2);
  for (let i = 0; i < s.count; i++) {
    // Whole pixels: bars side by side leave no seam.
    const x = edge(i), next = Math.max(x + 1, edge(i + 1));
    const more = s.agents[i] / most * room, low = s.objects[i] / most * room - more;
    if (low) { pen.fillStyle = colours["bar-objects"]; pen.fillRect(x, BASE - low, next - x, low); }
    if (more) { pen.fillStyle = colours["bar-agents"]; pen.fillRect(x, BASE - low - more, next - x, more); }
  }
  // Triangles stand over the sweeps that stand out.
  pen.fillStyle = colours.vermilion;
  for (const one of data.standing) {
    if (one.stream !== now.stream) continue;
    const x = X(place(s, one.sweep));
    polygon(pen, [[x - 4, 0], [x + 4, 0], [x, 7]]); pen.fill();
  }
  pen.strokeStyle = colours.quiet; pen.fillStyle = colours.quiet; pen.lineWidth = 1;
  line(pen, THUMB / 2, BASE, width - THUMB / 2, BASE);
  pen.textAlign = "center";
  const first = s.seconds[0], last = s.seconds[s.count - 1];
  for (const [t, text] of last > first ? ticks(first, last, width / 90) : []) {
    const x = X(nearest(s.seconds, t));
    pen.fillText(text + " s", Math.min(Math.max(x, 16), width - 20), height - 2);
  }
  pen.textAlign = "start";
  pen.fillStyle = colours.ink; pen.fillRect(X(k) - 1, 0, 2, BASE);
}

// A band for each zone: when its events went on, in the colour of what it asks for, and visits as thin bars.
const BAND = 16;

function drawZones(s, k, colours) {
  const canvas = get("zones");
  canvas.hidden = !s.zones.length;
  if (canvas.hidden) return;
  canvas.style.height = BAND * s.zones.length + "px";
  const { pen, width, height } = open("zones"), { step, X } = timeScale(s, width);
  const bar = ([from, to], y, high) => {
    const x = X(nearest(s.seconds, from)) - step / 2, next = X(nearest(s.seconds, to)) + step / 2;
    pen.fillRect(x, y, Math.max(2, next - x), high);
  };
  s.zones.forEach((zone, i) => {
    const y = BAND * i;
    pen.fillStyle = colours.grid; pen.fillRect(THUMB / 2, y + BAND - 2, width - THUMB, 1);
    pen.fillStyle = colours.zone(zone.action);
    for (const one of zone.events) bar(one, y + 2, BAND - 4);
    pen.fillStyle = colours.dark;
    for (const one of zone.visits) bar(one, y + BAND - 5, 3);
    const words = zone.name + (zone.action === "none" ? "" : " (" + zone.action + ")");
    pen.strokeStyle = colours.paper; pen.lineWidth = 3; pen.lineJoin = "round"; pen.strokeText(words, THUMB / 2 + 3, y + 11);
    pen.fillStyle = colours.ink; pen.fillText(words, THUMB / 2 + 3, y + 11);
  });
  pen.fillStyle = colours.ink; pen.fillRect(X(k) - 1, 0, 2, height);
}

function isActive(s, k, zone) {
  return zone.events.some(([from, to]) => s.seconds[k] >= from - 1e-3 && s.seconds[k] <= to + 1e-3);
}

function nearest(values, wanted) {
  let best = 0;
  for (let i = 0; i < values.length; i++) if (Math.abs(values[i] - wanted) < Math.abs(values[best] - wanted)) best = i;
  return best;
}

// The place of a sweep among those that are shown.
function place(s, sweep) { return nearest(s.sweep, sweep); }

function startTimeline() {
  const slider = get("slider");
  for (const line of [get("timeline"), get("zones")]) {
    const go = (event) => {
      const box = line.getBoundingClientRect();
      jump(timeScale(streams[now.stream], box.width).k(event.clientX - box.left));
    };
    line.addEventListener("pointerdown", (event) => { line.setPointerCapture(event.pointerId); go(event); });
    line.addEventListener("pointermove", (event) => { if (line.hasPointerCapture(event.pointerId)) go(event); });
  }
  slider.addEventListener("input", () => jump(Number(slider.value)));
}
