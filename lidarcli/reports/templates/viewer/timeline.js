// The time line: objects per sweep, the agents among them on top, over time; where sweeps are missing it is shaded.
const THUMB = 16, BASE = 40, GAP = 2.5;

function timeScale(s, width) {
  const room = width - THUMB, long = s.last - s.first;
  return {
    X: (t) => THUMB / 2 + (long > 0 ? (t - s.first) / long * room : 0),
    k: (x) => nearest(s.seconds, s.first + (x - THUMB / 2) / room * long),
  };
}

function drawTimeline(s, k, colours) {
  const { pen, width, height } = open("timeline"), { X } = timeScale(s, width);
  const most = s.objects.reduce((high, value) => Math.max(high, value), 1), room = BASE - 12;
  const edge = (i) => Math.floor(X(s.seconds[i] - s.step / 2));
  for (let i = 0; i < s.count; i++) {
    const left = edge(i), pause = i + 1 < s.count ? s.seconds[i + 1] - s.seconds[i] : 0, usual = X(s.seconds[i] + s.step / 2);
    // Whole pixels: bars side by side leave no seam.
    const x = Math.max(left + 1, pause > 0 && pause <= GAP * s.step ? edge(i + 1) : Math.floor(usual)), wide = x - left;
    if (pause > GAP * s.step) { pen.fillStyle = colours.grid; pen.fillRect(x, 0, edge(i + 1) - x, BASE); }
    const more = s.agents[i] / most * room, low = s.objects[i] / most * room - more;
    if (low) { pen.fillStyle = colours["bar-objects"]; pen.fillRect(left, BASE - low, wide, low); }
    if (more) { pen.fillStyle = colours["bar-agents"]; pen.fillRect(left, BASE - low - more, wide, more); }
  }
  // Triangles stand over the sweeps that stand out.
  pen.fillStyle = colours.vermilion;
  for (const one of data.standing) {
    if (one.stream !== now.stream) continue;
    const x = X(s.seconds[place(s, one.sweep)]);
    polygon(pen, [[x - 4, 0], [x + 4, 0], [x, 7]]); pen.fill();
  }
  pen.strokeStyle = colours.quiet; pen.fillStyle = colours.quiet; pen.lineWidth = 1;
  line(pen, THUMB / 2, BASE, width - THUMB / 2, BASE);
  pen.textAlign = "center";
  for (const [t, text] of s.last > s.first ? ticks(s.first, s.last, width / (s.begin === undefined ? 90 : 150)) : []) {
    const words = text + " s  " + clockAt(s, t), half = pen.measureText(words).width / 2;
    pen.fillText(words, Math.min(Math.max(X(t), half), width - half), height - 2);
  }
  pen.textAlign = "start";
  pen.fillStyle = colours.ink; pen.fillRect(X(s.seconds[k]) - 1, 0, 2, BASE);
}

// A band for each zone: when its events went on, in the colour of what it asks for, hatched where a topic had no sweep, and
// visits as thin bars; then what Nav2 did, and when the robot stood.
const BAND = 16;

function drawZones(s, k, colours) {
  const canvas = get("zones"), bands = s.zones.map((zone) => ({
    name: zone.name + (zone.action === "none" ? "" : " (" + zone.action + ")"),
    parts: [["stale", zone.stale], [zone.action, zone.events]], visits: zone.visits,
  })).concat(s.others);
  canvas.hidden = !bands.length;
  if (canvas.hidden) return;
  canvas.style.height = BAND * bands.length + "px";
  const { pen, width, height } = open("zones"), { X } = timeScale(s, width);
  const bar = ([from, to], y, high, hatched) => {
    const x = X(from - s.step / 2), wide = Math.max(2, X(to + s.step / 2) - x);
    if (!hatched) pen.fillRect(x, y, wide, high);
    else for (let i = 0; i < wide; i += 5) pen.fillRect(x + i, y, 2, high);
  };
  bands.forEach((band, i) => {
    const y = BAND * i;
    pen.fillStyle = colours.grid; pen.fillRect(THUMB / 2, y + BAND - 2, width - THUMB, 1);
    for (const [kind, spans] of band.parts) {
      pen.fillStyle = { stale: colours.quiet, still: colours.dark }[kind] || colours.zone(kind);
      for (const one of spans) bar(one, y + 2, BAND - 4, kind === "stale");
    }
    pen.fillStyle = colours.dark;
    for (const one of band.visits || []) bar(one, y + BAND - 5, 3);
    pen.strokeStyle = colours.paper; pen.lineWidth = 3; pen.lineJoin = "round"; pen.strokeText(band.name, THUMB / 2 + 3, y + 11);
    pen.fillStyle = colours.ink; pen.fillText(band.name, THUMB / 2 + 3, y + 11);
  });
  pen.fillStyle = colours.ink; pen.fillRect(X(s.seconds[k]) - 1, 0, 2, height);
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
  slider.addEventListener("input", () => jump(nearest(streams[now.stream].seconds, Number(slider.value))));
}
