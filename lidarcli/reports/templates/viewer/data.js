// The data of the page: sweeps as typed arrays, and the geometry of one of them.
const get = (id) => document.getElementById(id);
const LOST = 65535, TURN = 2 * Math.PI, DEGREES = 180 / Math.PI;
const OBJECT = 0, AGENT = 1, REST = 2;

// All arrays of a value, unpacked.
async function unpacked(value) {
  if (value === null || typeof value !== "object") return value;
  if (value.packed) {
    const raw = atob(value.packed), bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
    return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"))).arrayBuffer();
  }
  const done = await Promise.all(Object.entries(value).map(async ([name, one]) => [name, await unpacked(one)]));
  return Array.isArray(value) ? done.map(([, one]) => one) : Object.fromEntries(done);
}

if (typeof DecompressionStream === "undefined") get("words").textContent = "This browser is too old for the viewer (before 2023).";
const data = await unpacked(JSON.parse(get("data").textContent));

function decode(buffer, Kind) { return new Kind(buffer); }

// Numbers by the steps between them, as low bytes and high bytes.
function summed(bytes) {
  const size = bytes.length / 2, out = new Uint16Array(size);
  for (let i = 0, last = 0; i < size; i++) {
    const step = bytes[i] | (bytes[size + i] << 8);
    last = (last + ((step >> 1) ^ -(step & 1))) & LOST;
    out[i] = last;
  }
  return out;
}

function decodeAll(packed, names, Kind, into) {
  for (const name of names) into[name] = decode(packed[name], Kind);
  return into;
}

if (data.map) for (const runs of [data.map.free, data.map.occupied]) decodeAll({ ...runs }, ["row", "column", "length"], Uint16Array, runs);

function unpack(one) {
  const s = { log: one.log, topic: one.topic, frame: one.frame, count: one.count, scale: one.scale, zones: one.zones || [], others: one.others || [] };
  decodeAll(one, ["sweep", "offsets"], Int32Array, s);
  decodeAll(one, ["seconds", "d_th"], Float32Array, s);
  if (one.begin !== undefined) { s.begin = one.begin; decodeAll(one, ["shift"], Int32Array, s); }
  s.first = s.seconds.reduce((low, t) => Math.min(low, t), Infinity);
  s.last = s.seconds.reduce((high, t) => Math.max(high, t), -Infinity);
  const steps = s.seconds.slice(1).map((t, k) => t - s.seconds[k]).filter((step) => step > 0).sort();
  s.step = steps.length ? steps[steps.length >> 1] : 1;
  decodeAll(one, ["object", "objects", "agents"], Uint16Array, s);
  decodeAll(one, ["shape", "set"], Uint8Array, s);
  decodeAll(one, ["box_x", "box_y", "box_length", "box_width", "r_min", "box_yaw", "theta_i", "theta_f"], Int16Array, s);
  if (one.label) { s.labels = one.labels; s.label = decode(one.label, Uint16Array); }
  if (one.thing) s.thing = decode(one.thing, Uint8Array);
  if (one.pose) {
    s.pose = { side: one.pose.side, origin: one.pose.origin };
    decodeAll(one.pose, ["x", "y", "yaw"], Float32Array, s.pose);
  }
  if (one.tracks) {
    s.tracks = { speed: one.tracks.speed, track: decode(one.tracks.track, Int32Array) };
    decodeAll(one.tracks, ["vx", "vy"], Int16Array, s.tracks);
  }
  if (one.paths) {
    s.paths = { object: new Map(), agent: new Map() };
    decodeAll(one.paths, ["offsets", "track"], Int32Array, s.paths);
    decodeAll(one.paths, ["x", "y"], Float32Array, s.paths);
    decodeAll(one.paths, ["vx", "vy"], Int16Array, s.paths);
    decodeAll(one.paths, ["seen"], Uint8Array, s.paths);
    // Of each track the first object, and the sweep from which on it is an agent.
    for (let k = 0; k < s.count; k++) {
      for (let j = s.offsets[k]; j < s.offsets[k + 1]; j++) {
        const number = s.tracks.track[j];
        if (!s.paths.object.has(number)) s.paths.object.set(number, j);
        if (s.set[j] === AGENT && !s.paths.agent.has(number)) s.paths.agent.set(number, k);
      }
    }
  }
  if (one.raw) {
    s.raw = { scale: one.raw.scale, start: new Int32Array(one.count + 1) };
    decodeAll(one.raw, ["beams"], Int32Array, s.raw);
    decodeAll(one.raw, ["angle_min", "angle_increment"], Float32Array, s.raw);
    decodeAll(one.raw, ["closure"], Uint8Array, s.raw);
    s.raw.ranges = summed(decode(one.raw.ranges, Uint8Array));
    for (let k = 0; k < one.count; k++) s.raw.start[k + 1] = s.raw.start[k] + s.raw.beams[k];
  }
  return s;
}

// The time of day at some seconds of a stream; empty where its clock started near zero.
function clockAt(s, t) {
  return s.begin === undefined ? "" : new Date((s.begin + t + s.shift[nearest(s.seconds, t)]) * 1000 + 0.5).toISOString().slice(11, 21);
}

function timeWords(s, t) { return t.toFixed(2) + " s" + (s.begin === undefined ? "" : " (" + clockAt(s, t) + ")"); }

// The rows of the objects of sweep k, agents among them.
function members(s, k) {
  const found = [];
  for (let j = s.offsets[k]; j < s.offsets[k + 1]; j++) if (s.set[j] !== REST) found.push(j);
  return found;
}

// Corners of a box in the sensor frame [m].
function corners(s, j) {
  const x = s.box_x[j] * s.scale, y = s.box_y[j] * s.scale;
  const a = s.box_length[j] * s.scale / 2, b = s.box_width[j] * s.scale / 2, yaw = s.box_yaw[j] / data.angle;
  const c = Math.cos(yaw), d = Math.sin(yaw);
  return [[a, b], [-a, b], [-a, -b], [a, -b]].map(([u, v]) => [x + c * u - d * v, y + d * u + c * v]);
}

// Bearings, ranges and Def. 2's difference of one sweep; NaN where there is none.
function beams(s, k) {
  const r = s.raw, size = r.beams[k], start = r.start[k], step = r.angle_increment[k];
  const out = { theta: new Float64Array(size), r: new Float64Array(size), s: new Float64Array(size) };
  for (let n = 0; n < size; n++) {
    const value = r.ranges[start + n];
    out.theta[n] = r.angle_min[k] + step * n;
    out.r[n] = value === LOST ? NaN : value * r.scale;
  }
  // With a shared bearing the sweep is one beam shorter than it looks.
  const last = r.closure[k] === 2 ? size - 1 : size;
  for (let n = 0; n < size; n++) {
    let before = step < 0 ? n + 1 : n - 1;
    if (r.closure[k] && last > 1) before = (before + last) % last;
    out.s[n] = n >= last || before < 0 || before >= size ? NaN : out.r[n] - out.r[before];
  }
  return out;
}

// The row of the object or agent that a beam lies on; -1 for walls and the rest.
function owner(s, k, theta) {
  const slack = Math.abs(s.raw.angle_increment[k]) / 2;
  for (let j = s.offsets[k]; j < s.offsets[k + 1]; j++) {
    if (s.set[j] === REST) continue;
    const from = s.theta_i[j] / data.angle, width = s.theta_f[j] / data.angle - from;
    if (((theta - from + slack) % TURN + TURN) % TURN <= width + 2 * slack) return j;
  }
  return -1;
}

// The two frames that a scene is drawn in. Each knows where points of the sensor frame of sweep k
// and points over ground are, and how directions over ground turn.
function frameOf(s, k, world) {
  const same = (x, y) => [x, y], p = s.pose;
  if (!p) return { beam: same, ground: same, turned: same, known: true, origin: [0, 0] };
  const c = Math.cos(p.yaw[k]), d = Math.sin(p.yaw[k]), known = !isNaN(p.x[k]) && !isNaN(p.yaw[k]);
  if (world) return {
    beam: (x, y) => [p.x[k] + c * x - p.side * d * y, p.y[k] + d * x + p.side * c * y],
    ground: same, turned: same, known: known, origin: p.origin,
  };
  const turned = (x, y) => [c * x + d * y, p.side * (c * y - d * x)];
  return { beam: same, ground: (x, y) => turned(x - p.x[k], y - p.y[k]), turned: turned, known: true, origin: [0, 0] };
}

// The tracks of sweep k, each with its path over ground, the newest point first. They start
// `seconds` before; `ended` takes those, too, that do not go on.
function paths(s, k, seconds, most, ended) {
  const t = s.paths, found = new Map();
  for (let m = k; m >= 0 && k - m < most && Math.abs(s.seconds[k] - s.seconds[m]) <= seconds; m--) {
    for (let i = t.offsets[m]; i < t.offsets[m + 1]; i++) {
      const number = t.track[i];
      if (!found.has(number)) {
        if (m < k && !ended) continue;
        const object = t.object.get(number);
        found.set(number, {
          number: number, agent: t.agent.get(number) <= k, seen: m === k && t.seen[i] === 1, over: m < k,
          vx: t.vx[i] * s.tracks.speed, vy: t.vy[i] * s.tracks.speed, label: object === undefined ? "" : labelOf(s, object), points: [],
        });
      }
      found.get(number).points.push([t.x[i], t.y[i], t.seen[i] === 1]);
    }
  }
  return [...found.values()];
}

function labelOf(s, j) { return s.label && s.label[j] !== LOST ? s.labels[s.label[j]] : ""; }

// What is known of an object: name → value with its unit.
function detailsOf(s, j) {
  const metres = (value) => value.toFixed(2) + " m";
  const found = [["object", String(s.object[j])], ["kind", s.set[j] === AGENT ? "agent" : "object"], ["shape", data.shapes[s.shape[j]]]];
  found.push(["size", (s.box_length[j] * s.scale).toFixed(2) + " \u00d7 " + metres(s.box_width[j] * s.scale)]);
  found.push(["distance", metres(s.r_min[j] * s.scale)]);
  if (s.tracks && s.tracks.track[j] > 0) {
    found.push(["track", String(s.tracks.track[j])]);
    found.push(["speed", (Math.hypot(s.tracks.vx[j], s.tracks.vy[j]) * s.tracks.speed).toFixed(2) + " m/s"]);
  }
  // 255 stands for what is not known.
  if (s.thing && s.thing[j] !== 255) found.push(["thing", Math.round(s.thing[j] / 2.54) + " %"]);
  if (labelOf(s, j)) found.push(["label", labelOf(s, j)]);
  return found;
}
