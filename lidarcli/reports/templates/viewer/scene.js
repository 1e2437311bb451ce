// The scene from above: beams, boxes, tracks; as the sensor sees it, or in the world.
const PATH_SECONDS = 3, WORLD_SECONDS = 60, PATH_SWEEPS = 2000;
// Of more tracks that have ended nobody could read the numbers.
const MAX_NUMBERS = 60;
const MARGIN = { left: 44, right: 8, top: 18, bottom: 34 };

// The view of the ground that holds all sweeps of a stream, so that the picture does not jump, and the limits of the curves.
function measure(s) {
  const sensor = [0, 0, 0, 0], ground = [Infinity, -Infinity, Infinity, -Infinity];
  let reach = 0, jump = 0, low = Infinity, high = -Infinity;
  const hold = (bounds, x, y) => {
    if (!isFinite(x) || !isFinite(y)) return;
    if (x < bounds[0]) bounds[0] = x;
    if (x > bounds[1]) bounds[1] = x;
    if (y < bounds[2]) bounds[2] = y;
    if (y > bounds[3]) bounds[3] = y;
  };
  for (let k = 0; k < s.count; k++) {
    const world = s.pose ? frameOf(s, k, true) : null;
    if (world) hold(ground, s.pose.x[k], s.pose.y[k]);
    const here = (x, y) => {
      hold(sensor, x, y);
      if (world) hold(ground, ...world.beam(x, y));
      reach = Math.max(reach, Math.hypot(x, y) || 0);
    };
    for (let j = s.offsets[k]; j < s.offsets[k + 1]; j++) corners(s, j).forEach(([x, y]) => here(x, y));
    const sweep = s.raw ? beams(s, k) : { theta: [] };
    sweep.theta.forEach((theta, n) => {
      low = Math.min(low, theta);
      high = Math.max(high, theta);
      if (!isNaN(sweep.r[n])) here(sweep.r[n] * Math.cos(theta), sweep.r[n] * Math.sin(theta));
      jump = Math.max(jump, Math.abs(sweep.s[n]) || 0);
    });
  }
  const seen = isFinite(low) && isFinite(high) && high > low;
  s.curves = { reach: 1.05 * Math.max(reach, 0.1), jump: 1.1 * Math.max(jump, 0.1), low: seen ? low : -Math.PI, high: seen ? high : Math.PI };
  s.whole = { sensor: airy(sensor), world: airy(ground[0] <= ground[1] ? ground : null) };
  s.view = { sensor: { ...s.whole.sensor }, world: { ...s.whole.world } };
}

function airy(bounds) {
  if (!bounds) return { x: 0, y: 0, width: 1, height: 1 };
  const [x0, x1, y0, y1] = bounds, air = 0.06 * Math.max(x1 - x0, y1 - y0, 0.2);
  return { x: (x0 + x1) / 2, y: (y0 + y1) / 2, width: x1 - x0 + 2 * air, height: y1 - y0 + 2 * air };
}

// Metres ↔ pixels of a drawing of this size.
function projection(view, width, height) {
  const w = width - MARGIN.left - MARGIN.right, h = height - MARGIN.top - MARGIN.bottom;
  const scale = Math.min(w / view.width, h / view.height), u = MARGIN.left + w / 2, v = MARGIN.top + h / 2;
  return {
    scale: scale, w: w, h: h,
    X: (x) => u + (x - view.x) * scale, Y: (y) => v - (y - view.y) * scale,
    x: (pixel) => view.x + (pixel - u) / scale, y: (pixel) => view.y - (pixel - v) / scale,
  };
}

// Everything of one scene; `chosen` is the row of an object that is marked, or -1.
function drawScene(pen, width, height, scene, colours) {
  const { s, k, world, chosen } = scene, p = projection(scene.view, width, height), frame = frameOf(s, k, world), names = [];
  pen.save(); pen.beginPath(); pen.rect(MARGIN.left, MARGIN.top, p.w, p.h); pen.clip();
  if (world) drawMap(pen, p, frame.origin, colours);
  pen.restore();
  axes(pen, p, frame.origin, colours);
  pen.save(); pen.beginPath(); pen.rect(MARGIN.left, MARGIN.top, p.w, p.h); pen.clip();
  if (world) drawPath(pen, s, k, p, colours);
  if (frame.known) {
    const active = drawOutlines(pen, s, k, p, frame, colours, names);
    if (s.raw) drawPoints(pen, s, k, p, frame, colours, active);
    for (const j of members(s, k)) drawBox(pen, s, j, p, frame, colours, names, j === chosen);
  }
  if (s.paths) drawTracks(pen, s, k, p, frame, colours, names, world);
  drawNames(pen, names, colours.paper);
  if (frame.known) {
    const tip = [[0, 0, 8, 0], [0, 0, -5, -5], [0, 0, -5, 5]].map(([x, y, a, b]) => {
      const [u, v] = frame.beam(x + a / p.scale, y + b / p.scale);
      return [p.X(u), p.Y(v)];
    });
    pen.fillStyle = colours.ink; polygon(pen, tip); pen.fill();
  } else word(pen, "no pose is known for this sweep", MARGIN.left + p.w / 2, MARGIN.top + 14, colours.quiet, colours.paper);
  pen.restore();
}

// Lines at round numbers; their words stand outside, where nothing is drawn.
function axes(pen, p, origin, colours) {
  const right = MARGIN.left + p.w, bottom = MARGIN.top + p.h;
  pen.strokeStyle = colours.grid; pen.fillStyle = colours.quiet; pen.lineWidth = 1;
  pen.textAlign = "center";
  for (const [t, text] of ticks(p.x(MARGIN.left) + origin[0], p.x(right) + origin[0], p.w / 55)) {
    const u = p.X(t - origin[0]);
    line(pen, u, MARGIN.top, u, bottom);
    if (u > MARGIN.left + 6 && u < right - 6) pen.fillText(text, u, bottom + 14);
  }
  pen.fillText("x [m]", MARGIN.left + p.w / 2, bottom + 29);
  pen.textAlign = "right";
  for (const [t, text] of ticks(p.y(bottom) + origin[1], p.y(MARGIN.top) + origin[1], p.h / 50)) {
    const v = p.Y(t - origin[1]);
    line(pen, MARGIN.left, v, right, v);
    pen.fillText(text, MARGIN.left - 5, v + 4);
  }
  pen.textAlign = "start"; pen.fillText("y [m]", 4, 11);
}

// The outlines of zones; thick, with their names, while an event goes on. Returns those, in pixels.
function drawOutlines(pen, s, k, p, frame, colours, names) {
  const active = [];
  for (const zone of s.zones) {
    if (!zone.outline.length || (zone.frame === "world" && !s.pose)) continue;
    const place = zone.frame === "world" ? ([x, y]) => frame.ground(x - s.pose.origin[0], y - s.pose.origin[1]) : ([x, y]) => frame.beam(x, y);
    const points = zone.outline.map(place).map(([x, y]) => [p.X(x), p.Y(y)]), on = isActive(s, k, zone);
    pen.strokeStyle = colours.zone(zone.action); pen.lineWidth = on ? 3 : 1;
    pen.setLineDash(on ? [] : [5, 3]);
    polygon(pen, points); pen.stroke();
    pen.setLineDash([]);
    if (!on) continue;
    active.push({ points: points, colour: pen.strokeStyle });
    const [u, v] = points.reduce((top, one) => (one[1] < top[1] ? one : top));
    names.push({ text: zone.name, x: u, y: v - 9, u: u, v: v, colour: colours.ink });
  }
  return active;
}

function isInside(points, u, v) {
  let odd = false;
  points.forEach(([a, b], i) => {
    const [c, d] = points[(i + points.length - 1) % points.length];
    if ((b > v) !== (d > v) && u < a + (v - b) * (c - a) / (d - b)) odd = !odd;
  });
  return odd;
}

function drawPoints(pen, s, k, p, frame, colours, active) {
  const sweep = beams(s, k);
  for (let n = 0; n < sweep.r.length; n++) {
    if (isNaN(sweep.r[n])) continue;
    const j = owner(s, k, sweep.theta[n]), [x, y] = frame.beam(sweep.r[n] * Math.cos(sweep.theta[n]), sweep.r[n] * Math.sin(sweep.theta[n]));
    const u = p.X(x), v = p.Y(y), zone = active.find((one) => isInside(one.points, u, v));
    pen.fillStyle = zone ? zone.colour : ofOwner(s, j, colours);
    dot(pen, u, v, zone ? 3 : j < 0 ? 1.2 : 2.1);
  }
}

function ofOwner(s, j, colours) { return j < 0 ? colours.grey : s.set[j] === AGENT ? colours.vermilion : colours.blue; }

// The box of an object; of a round one the circle that was fitted to it.
function outline(s, j) {
  if (data.shapes[s.shape[j]] !== "round") return corners(s, j);
  const x = s.box_x[j] * s.scale, y = s.box_y[j] * s.scale, r = s.box_length[j] * s.scale / 2, found = [];
  for (let n = 0; n < 36; n++) found.push([x + r * Math.cos(n * TURN / 36), y + r * Math.sin(n * TURN / 36)]);
  return found;
}

function drawBox(pen, s, j, p, frame, colours, names, marked) {
  const box = outline(s, j).map(([x, y]) => { const [a, b] = frame.beam(x, y); return [p.X(a), p.Y(b)]; });
  if (marked) { pen.strokeStyle = colours.ink; pen.lineWidth = 6; polygon(pen, box); pen.stroke(); }
  pen.strokeStyle = colours.shapes[s.shape[j]]; pen.lineWidth = 2;
  polygon(pen, box); pen.stroke();
  // What was followed bears the number of its track.
  if (s.paths && s.tracks.track[j] > 0) return;
  const [a, b] = frame.beam(s.box_x[j] * s.scale, s.box_y[j] * s.scale), [c, d] = frame.beam(0, 0);
  const u = p.X(a), v = p.Y(b), far = Math.hypot(a - c, b - d) || 1, x = (a - c) / far, y = (d - b) / far;
  const out = Math.max(...box.map(([e, f]) => (e - u) * x + (f - v) * y)) + 11;
  const label = s.tracks ? "" : labelOf(s, j);
  names.push({ text: s.object[j] + (label ? " " + label : ""), x: u + x * out, y: v + y * out, u: u, v: v, colour: colours.ink });
}

// Agents are triangles, objects circles; hollow where the thing is hidden in this sweep. The arrow is the way of a second.
function drawTracks(pen, s, k, p, frame, colours, names, world) {
  const found = paths(s, k, world ? WORLD_SECONDS : PATH_SECONDS, PATH_SWEEPS, world);
  const named = found.filter((one) => one.over).length <= MAX_NUMBERS;
  for (const one of found) {
    const points = one.points.map(([x, y, seen]) => [...frame.ground(x, y), seen]).filter(([x]) => !isNaN(x));
    if (!points.length) continue;
    const [x, y] = points[0], u = p.X(x), v = p.Y(y), colour = one.agent ? colours.vermilion : colours.blue;
    pen.strokeStyle = colour; pen.lineWidth = one.over ? 0.8 : one.agent ? 2 : 1.2;
    pen.beginPath();
    // No line where no sweep saw it go.
    points.forEach(([a, b, seen], i) => (i && seen && points[i - 1][2] ? pen.lineTo(p.X(a), p.Y(b)) : pen.moveTo(p.X(a), p.Y(b))));
    pen.stroke();
    if (one.over) {
      pen.fillStyle = colour; dot(pen, u, v, 2);
      if (named) names.push({ text: String(one.number), x: u + 8, y: v - 8, u: u, v: v, colour: colour });
      continue;
    }
    const [vx, vy] = frame.turned(one.vx, one.vy), speed = Math.hypot(vx, vy);
    if (one.seen && speed > 0) arrow(pen, u, v, p.X(x + vx), p.Y(y + vy));
    pen.fillStyle = one.seen ? colour : colours.paper; pen.lineWidth = 1.5;
    pen.beginPath();
    if (one.agent) { pen.moveTo(u, v - 6); pen.lineTo(u + 5.5, v + 4); pen.lineTo(u - 5.5, v + 4); pen.closePath(); }
    else pen.arc(u, v, 3.5, 0, TURN);
    pen.fill(); pen.stroke();
    // Beside the head, on the side that it does not move to.
    const [c, d] = frame.beam(0, 0), far = Math.hypot(x - c, y - d) || 1;
    const dx = speed > 0 ? -vx / speed : (x - c) / far || 0, dy = speed > 0 ? -vy / speed : (y - d) / far || 0;
    const words = one.number + (one.label ? " " + one.label : "");
    names.push({ text: words, x: u + dx * (12 + 3 * words.length), y: v - dy * 16, u: u, v: v, colour: colour });
  }
}

// The map: what beams of any sweep have hit, what they have passed, and in the colour of the ground what nobody knows.
function drawMap(pen, p, origin, colours) {
  const map = data.map, side = map ? map.cell * p.scale : 0;
  if (!map) return;
  pen.fillStyle = colours.raised; pen.fillRect(MARGIN.left, MARGIN.top, p.w, p.h);
  for (const [runs, colour] of [[map.free, colours.paper], [map.occupied, colours.light]]) {
    pen.fillStyle = colour;
    for (let n = 0; n < runs.row.length; n++) {
      const x = map.origin[0] + runs.column[n] * map.cell - origin[0], y = map.origin[1] + (runs.row[n] + 1) * map.cell - origin[1];
      // Runs that meet leave no seam.
      pen.fillRect(p.X(x), p.Y(y), runs.length[n] * side + 0.3, side + 0.3);
    }
  }
}

// The way of the sensor: thin as a whole, thick up to now.
function drawPath(pen, s, k, p, colours) {
  pen.strokeStyle = colours.green;
  for (const [last, width] of [[s.count - 1, 0.8], [k, 2]]) {
    let drawing = false;
    pen.lineWidth = width; pen.beginPath();
    for (let m = 0; m <= last; m++) {
      if (isNaN(s.pose.x[m])) { drawing = false; continue; }
      if (drawing) pen.lineTo(p.X(s.pose.x[m]), p.Y(s.pose.y[m])); else pen.moveTo(p.X(s.pose.x[m]), p.Y(s.pose.y[m]));
      drawing = true;
    }
    pen.stroke();
  }
}
