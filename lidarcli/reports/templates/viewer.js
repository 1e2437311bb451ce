"use strict";
(function () {
  const data = JSON.parse(document.getElementById("data").textContent);
  if (!data.streams.length) return;
  const get = (id) => document.getElementById(id);
  const BLUE = "#0072B2", VERMILION = "#D55E00", GREY = "#8C8C8C", LIGHT = "#E4E4E4", SKY = "rgba(86,180,233,0.28)", INK = "#1a1a1a";
  const PATH_SECONDS = 3, PATH_SWEEPS = 200;
  const LOST = 65535, TURN = 2 * Math.PI, DEGREES = 180 / Math.PI;

  function decode(text, Kind) {
    const raw = atob(text), bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
    return new Kind(bytes.buffer);
  }

  const streams = data.streams.map((one) => {
    const s = { name: one.name, count: one.count, scale: one.scale };
    s.sweep = decode(one.sweep, Int32Array);
    s.seconds = decode(one.seconds, Float32Array);
    s.dth = decode(one.d_th, Float32Array);
    s.offsets = decode(one.offsets, Int32Array);
    s.object = decode(one.object, Uint16Array);
    s.shape = decode(one.shape, Uint8Array);
    s.set = decode(one.set, Uint8Array);
    for (const name of ["box_x", "box_y", "box_length", "box_width", "box_yaw", "theta_i", "theta_f"]) s[name] = decode(one[name], Int16Array);
    if (one.label) { s.labels = one.labels; s.label = decode(one.label, Uint16Array); }
    if (one.tracks) {
      const t = { speed: one.tracks.speed, track: decode(one.tracks.track, Int32Array) };
      for (const name of ["x", "y"]) t[name] = decode(one.tracks[name], Float32Array);
      for (const name of ["vx", "vy"]) t[name] = decode(one.tracks[name], Int16Array);
      if (one.tracks.pose) {
        t.pose = { side: one.tracks.pose.side };
        for (const name of ["x", "y", "yaw"]) t.pose[name] = decode(one.tracks.pose[name], Float32Array);
      }
      t.last = new Map();
      for (let k = 0; k < s.count; k++) for (let j = s.offsets[k]; j < s.offsets[k + 1]; j++) t.last.set(t.track[j], k);
      s.tracks = t;
    }
    if (one.raw) {
      const r = { scale: one.raw.scale };
      r.beams = decode(one.raw.beams, Int32Array);
      r.min = decode(one.raw.angle_min, Float32Array);
      r.step = decode(one.raw.angle_increment, Float32Array);
      r.closure = decode(one.raw.closure, Uint8Array);
      r.ranges = decode(one.raw.ranges, Uint16Array);
      r.start = new Int32Array(one.count + 1);
      for (let k = 0; k < one.count; k++) r.start[k + 1] = r.start[k] + r.beams[k];
      s.raw = r;
    }
    measure(s);
    return s;
  });

  // The axes hold all sweeps of a stream, so that the picture does not jump.
  function measure(s) {
    let x0 = 0, x1 = 0, y0 = 0, y1 = 0, reach = 0.1, jump = 0.1, low = Infinity, high = -Infinity;
    const take = (x, y) => {
      x0 = Math.min(x0, x); x1 = Math.max(x1, x); y0 = Math.min(y0, y); y1 = Math.max(y1, y);
      reach = Math.max(reach, Math.hypot(x, y));
    };
    for (let k = 0; k < s.object.length; k++) for (const [x, y] of corners(s, k)) take(x, y);
    if (s.raw) {
      for (let k = 0; k < s.count; k++) {
        const sweep = beams(s, k);
        for (let n = 0; n < sweep.r.length; n++) {
          low = Math.min(low, sweep.theta[n]); high = Math.max(high, sweep.theta[n]);
          if (!isNaN(sweep.r[n])) take(sweep.r[n] * Math.cos(sweep.theta[n]), sweep.r[n] * Math.sin(sweep.theta[n]));
          if (!isNaN(sweep.s[n])) jump = Math.max(jump, Math.abs(sweep.s[n]));
        }
      }
    }
    if (!(high > low)) { low = -Math.PI; high = Math.PI; }
    const size = Math.max(x1 - x0, y1 - y0, 0.2) * 1.12;
    s.view = { x: (x0 + x1) / 2, y: (y0 + y1) / 2, size: size, reach: reach * 1.05, jump: jump * 1.1, low: low, high: high };
    s.most = 1;
    for (let k = 0; k < s.count; k++) s.most = Math.max(s.most, things(s, k) + agents(s, k));
  }

  function things(s, k) {
    let count = 0;
    for (let j = s.offsets[k]; j < s.offsets[k + 1]; j++) count += s.set[j] === 0;
    return count;
  }

  // Agents are counted by their tracks: a person on two legs is one.
  function agents(s, k) {
    if (!s.tracks) return 0;
    const seen = new Set();
    for (let j = s.offsets[k]; j < s.offsets[k + 1]; j++) if (s.set[j] === 1) seen.add(s.tracks.track[j]);
    return seen.size;
  }

  // Directions over ground, and points over ground, in the sensor frame of sweep k.
  function turned(t, k, x, y) {
    if (!t.pose) return [x, y];
    const c = Math.cos(t.pose.yaw[k]), d = Math.sin(t.pose.yaw[k]);
    return [c * x + d * y, t.pose.side * (c * y - d * x)];
  }

  function toSensor(t, k, x, y) { return t.pose ? turned(t, k, x - t.pose.x[k], y - t.pose.y[k]) : [x, y]; }

  // The tracks that go on in sweep k, each with its path of the last seconds in the sensor frame, the newest point first.
  function paths(s, k) {
    const t = s.tracks, found = new Map();
    for (let m = k; m >= 0 && k - m < PATH_SWEEPS && Math.abs(s.seconds[k] - s.seconds[m]) <= PATH_SECONDS; m--) {
      const here = new Map();
      for (let j = s.offsets[m]; j < s.offsets[m + 1]; j++) {
        if (t.track[j] < 1 || t.last.get(t.track[j]) < k || s.set[j] === 2 || isNaN(t.x[j])) continue;
        const sum = here.get(t.track[j]) || { x: 0, y: 0, n: 0, j: j };
        sum.x += t.x[j]; sum.y += t.y[j]; sum.n += 1;
        here.set(t.track[j], sum);
      }
      here.forEach((sum, number) => {
        const [x, y] = toSensor(t, k, sum.x / sum.n, sum.y / sum.n);
        if (isNaN(x)) return;
        if (!found.has(number)) {
          const [vx, vy] = turned(t, k, t.vx[sum.j] * t.speed, t.vy[sum.j] * t.speed);
          const label = s.label && s.label[sum.j] !== LOST ? s.labels[s.label[sum.j]] : "";
          found.set(number, { number: number, agent: s.set[sum.j] === 1, seen: m === k, vx: vx, vy: vy, label: label, points: [] });
        }
        found.get(number).points.push([x, y]);
      });
    }
    return [...found.values()];
  }

  function corners(s, k) {
    const x = s.box_x[k] * s.scale, y = s.box_y[k] * s.scale;
    const a = s.box_length[k] * s.scale / 2, b = s.box_width[k] * s.scale / 2, yaw = s.box_yaw[k] / data.angle;
    const c = Math.cos(yaw), d = Math.sin(yaw);
    return [[a, b], [-a, b], [-a, -b], [a, -b]].map(([u, v]) => [x + c * u - d * v, y + d * u + c * v]);
  }

  // Bearings, ranges and Def. 2's difference of one sweep; NaN where there is none.
  function beams(s, k) {
    const r = s.raw, count = r.beams[k], start = r.start[k], step = r.step[k];
    const out = { theta: new Float64Array(count), r: new Float64Array(count), s: new Float64Array(count) };
    for (let n = 0; n < count; n++) {
      const value = r.ranges[start + n];
      out.theta[n] = r.min[k] + step * n;
      out.r[n] = value === LOST ? NaN : value * r.scale;
    }
    // With a shared bearing the sweep is one beam shorter than it looks.
    const last = r.closure[k] === 2 ? count - 1 : count;
    for (let n = 0; n < count; n++) {
      let before = step < 0 ? n + 1 : n - 1;
      if (r.closure[k] && last > 1) before = (before + last) % last;
      out.s[n] = n >= last || before < 0 || before >= count ? NaN : out.r[n] - out.r[before];
    }
    return out;
  }

  function inside(s, j, theta, step) {
    const from = s.theta_i[j] / data.angle, width = s.theta_f[j] / data.angle - from;
    const slack = Math.abs(step) / 2;
    return ((theta - from + slack) % TURN + TURN) % TURN <= width + 2 * slack;
  }

  function open(id) {
    const canvas = get(id), ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
    if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.font = "11px system-ui, sans-serif";
    return { pen: pen, width: width, height: height };
  }

  function ticks(low, high, most) {
    const raw = (high - low) / most, power = Math.pow(10, Math.floor(Math.log10(raw)));
    const step = [1, 2, 5, 10].find((m) => m * power >= raw) * power, out = [];
    for (let t = Math.ceil(low / step) * step; t <= high + 1e-9; t += step) out.push(Math.abs(t) < step / 1e6 ? 0 : t);
    return out;
  }

  const short = (value) => String(Math.round(value * 1000) / 1000);

  function drawScene(s, k) {
    const { pen, width, height } = open("scene"), v = s.view;
    const scale = Math.min(width, height) / v.size;
    const X = (x) => width / 2 + (x - v.x) * scale, Y = (y) => height / 2 - (y - v.y) * scale;
    pen.strokeStyle = LIGHT; pen.fillStyle = GREY; pen.lineWidth = 1;
    const half = v.size / 2;
    for (const t of ticks(v.x - half, v.x + half, 8)) { line(pen, X(t), 0, X(t), height); pen.fillText(short(t), X(t) + 2, height - 3); }
    for (const t of ticks(v.y - half, v.y + half, 8)) { line(pen, 0, Y(t), width, Y(t)); pen.fillText(short(t), 2, Y(t) - 2); }
    if (s.raw) {
      const sweep = beams(s, k), step = s.raw.step[k];
      for (let n = 0; n < sweep.r.length; n++) {
        if (isNaN(sweep.r[n])) continue;
        const mine = member(s, k, sweep.theta[n], step);
        pen.fillStyle = COLOURS[mine];
        dot(pen, X(sweep.r[n] * Math.cos(sweep.theta[n])), Y(sweep.r[n] * Math.sin(sweep.theta[n])), mine ? 2.1 : 1.2);
      }
    }
    for (let j = s.offsets[k]; j < s.offsets[k + 1]; j++) {
      if (s.set[j] === 2) continue;
      const box = corners(s, j);
      pen.strokeStyle = data.colours[s.shape[j]]; pen.lineWidth = 2;
      pen.beginPath();
      box.forEach(([x, y], i) => (i ? pen.lineTo(X(x), Y(y)) : pen.moveTo(X(x), Y(y))));
      pen.closePath(); pen.stroke();
      const x = s.box_x[j] * s.scale, y = s.box_y[j] * s.scale, far = Math.hypot(x, y) || 1;
      const out = Math.max(...box.map(([a, b]) => ((a - x) * x + (b - y) * y) / far)) + 11 / scale;
      // What was followed bears the number of its track.
      if (s.tracks && s.tracks.track[j] > 0) continue;
      const label = !s.tracks && s.label && s.label[j] !== LOST ? " " + s.labels[s.label[j]] : "";
      number(pen, s.object[j] + label, X(x + x / far * out), Y(y + y / far * out), INK);
    }
    if (s.tracks) drawTracks(s, k, pen, X, Y, scale);
    pen.fillStyle = INK;
    pen.beginPath(); pen.moveTo(X(0) + 8, Y(0)); pen.lineTo(X(0) - 5, Y(0) - 5); pen.lineTo(X(0) - 5, Y(0) + 5); pen.closePath(); pen.fill();
  }

  function number(pen, text, x, y, colour) {
    pen.textAlign = "center"; pen.textBaseline = "middle"; pen.font = "bold 12px system-ui, sans-serif";
    pen.strokeStyle = "#fff"; pen.lineWidth = 3; pen.lineJoin = "round"; pen.strokeText(text, x, y);
    pen.fillStyle = colour; pen.fillText(text, x, y);
    pen.textAlign = "start"; pen.textBaseline = "alphabetic"; pen.font = "11px system-ui, sans-serif";
  }

  // Agents are triangles, objects circles; hollow where the thing is hidden in this sweep. The arrow is the way of a second.
  function drawTracks(s, k, pen, X, Y, scale) {
    for (const one of paths(s, k)) {
      const [x, y] = one.points[0], u = X(x), v = Y(y), colour = one.agent ? VERMILION : BLUE;
      pen.strokeStyle = colour; pen.lineWidth = one.agent ? 2 : 1.2;
      pen.beginPath();
      one.points.forEach(([a, b], i) => (i ? pen.lineTo(X(a), Y(b)) : pen.moveTo(X(a), Y(b))));
      pen.stroke();
      const speed = Math.hypot(one.vx, one.vy);
      if (one.seen && speed > 0) arrow(pen, u, v, X(x + one.vx), Y(y + one.vy));
      pen.fillStyle = one.seen ? colour : "#fff"; pen.lineWidth = 1.5;
      pen.beginPath();
      if (one.agent) { pen.moveTo(u, v - 6); pen.lineTo(u + 5.5, v + 4); pen.lineTo(u - 5.5, v + 4); pen.closePath(); }
      else pen.arc(u, v, 3.5, 0, TURN);
      pen.fill(); pen.stroke();
      // Beside the head, on the side that it does not move to.
      const back = speed > 0 ? 1 / speed : 0, far = Math.hypot(x, y) || 1;
      const dx = speed > 0 ? -one.vx * back : x / far, dy = speed > 0 ? -one.vy * back : y / far;
      const words = one.number + (one.label ? " " + one.label : "");
      number(pen, words, u + dx * (12 + 3 * words.length), v - dy * 16, colour);
    }
  }

  function arrow(pen, a, b, c, d) {
    const length = Math.hypot(c - a, d - b);
    if (length < 2) return;
    const x = (c - a) / length, y = (d - b) / length, head = Math.min(7, length);
    line(pen, a, b, c, d);
    line(pen, c, d, c - head * (x + 0.5 * y), d - head * (y - 0.5 * x));
    line(pen, c, d, c - head * (x - 0.5 * y), d - head * (y + 0.5 * x));
  }

  // The set that a beam belongs to: 0 for none, 1 objects, 2 agents.
  const COLOURS = [GREY, BLUE, VERMILION];

  function member(s, k, theta, step) {
    for (let j = s.offsets[k]; j < s.offsets[k + 1]; j++) if (s.set[j] !== 2 && inside(s, j, theta, step)) return s.set[j] + 1;
    return 0;
  }

  function curves(id, s, k, low, high) {
    const { pen, width, height } = open(id), v = s.view;
    const left = 40, bottom = height - 20, top = 6;
    const X = (theta) => left + (theta - v.low) / (v.high - v.low) * (width - left - 6);
    const Y = (value) => bottom - (value - low) / (high - low) * (bottom - top);
    for (let j = s.offsets[k]; j < s.offsets[k + 1]; j++) {
      if (s.set[j] === 2) continue;
      const slack = s.raw ? Math.abs(s.raw.step[k]) / 2 : 0.005, length = (s.theta_f[j] - s.theta_i[j]) / data.angle;
      const from = v.low + ((s.theta_i[j] / data.angle - v.low + 1e-4) % TURN + TURN) % TURN;
      pen.fillStyle = SKY;
      for (const shift of [0, -TURN]) {
        const a = Math.max(v.low - slack, from + shift - slack), b = Math.min(v.high + slack, from + shift + length + slack);
        if (b > a) pen.fillRect(X(a), top, Math.max(X(b) - X(a), 1.5), bottom - top);
      }
    }
    pen.strokeStyle = LIGHT; pen.fillStyle = "#5c5c5c"; pen.lineWidth = 1;
    for (const t of ticks(low, high, 5)) { line(pen, left, Y(t), width, Y(t)); pen.textAlign = "right"; pen.fillText(short(t), left - 5, Y(t) + 4); }
    pen.textAlign = "center";
    const wide = (v.high - v.low) * DEGREES > 200 ? 90 : 30;
    for (let t = Math.ceil((v.low * DEGREES - 0.5) / wide) * wide; t <= v.high * DEGREES + 0.5; t += wide) { line(pen, X(t / DEGREES), bottom, X(t / DEGREES), bottom + 4); pen.fillText(t + "\u00b0", Math.min(X(t / DEGREES), width - 14), bottom + 16); }
    pen.textAlign = "start"; pen.fillText("m", 4, top + 9);
    return { pen: pen, X: X, Y: Y, left: left, width: width };
  }

  function drawRange(s, k) {
    const { pen, X, Y } = curves("range", s, k, 0, s.view.reach);
    if (!s.raw) return;
    const sweep = beams(s, k), step = s.raw.step[k];
    for (let n = 0; n < sweep.r.length; n++) {
      if (isNaN(sweep.r[n])) continue;
      const mine = member(s, k, sweep.theta[n], step);
      pen.fillStyle = COLOURS[mine];
      dot(pen, X(sweep.theta[n]), Y(sweep.r[n]), mine ? 1.8 : 1.1);
    }
  }

  function drawDifference(s, k) {
    const { pen, X, Y, left, width } = curves("difference", s, k, -s.view.jump, s.view.jump);
    const limit = s.dth[k];
    if (s.raw) {
      const sweep = beams(s, k);
      for (let n = 0; n < sweep.s.length; n++) {
        if (isNaN(sweep.s[n])) continue;
        const beyond = Math.abs(sweep.s[n]) > limit;
        pen.strokeStyle = pen.fillStyle = beyond ? VERMILION : GREY;
        pen.lineWidth = beyond ? 1.4 : 1;
        line(pen, X(sweep.theta[n]), Y(0), X(sweep.theta[n]), Y(sweep.s[n]));
        if (beyond) dot(pen, X(sweep.theta[n]), Y(sweep.s[n]), 2);
      }
    }
    pen.strokeStyle = INK; pen.lineWidth = 0.7; line(pen, left, Y(0), width, Y(0));
    pen.strokeStyle = BLUE; pen.lineWidth = 1; pen.setLineDash([5, 3]);
    line(pen, left, Y(limit), width, Y(limit)); line(pen, left, Y(-limit), width, Y(-limit));
    pen.setLineDash([]);
  }

  // Objects per sweep, agents above them; vermilion triangles stand over the sweeps that stand out.
  function drawTimeline(s, k) {
    const { pen, width, height } = open("timeline"), step = width / s.count;
    for (let i = 0; i < s.count; i++) {
      const high = things(s, i) / s.most * (height - 12), more = agents(s, i) / s.most * (height - 12);
      pen.fillStyle = "#9ecae9";
      pen.fillRect(i * step, height - high, Math.max(step, 1), high);
      pen.fillStyle = "#eca77c";
      pen.fillRect(i * step, height - high - more, Math.max(step, 1), more);
    }
    pen.fillStyle = VERMILION;
    for (const one of data.standing) {
      if (one.stream !== now.stream) continue;
      const x = (place(s, one.sweep) + 0.5) * step;
      pen.beginPath(); pen.moveTo(x - 4, 0); pen.lineTo(x + 4, 0); pen.lineTo(x, 7); pen.closePath(); pen.fill();
    }
    pen.fillStyle = INK; pen.fillRect((k + 0.5) * step - 1, 0, 2, height);
  }

  function line(pen, a, b, c, d) { pen.beginPath(); pen.moveTo(a, b); pen.lineTo(c, d); pen.stroke(); }
  function dot(pen, x, y, r) { pen.beginPath(); pen.arc(x, y, r, 0, TURN); pen.fill(); }

  // The place of a sweep among those that are shown.
  function place(s, sweep) {
    let best = 0;
    for (let i = 0; i < s.count; i++) if (Math.abs(s.sweep[i] - sweep) < Math.abs(s.sweep[best] - sweep)) best = i;
    return best;
  }

  const now = { stream: 0, k: 0, timer: null };

  function show() {
    const s = streams[now.stream];
    if (!s.count) return;
    now.k = Math.max(0, Math.min(s.count - 1, now.k));
    get("slider").value = now.k;
    const count = things(s, now.k), many = agents(s, now.k);
    const why = data.standing.filter((one) => one.stream === now.stream && one.sweep === s.sweep[now.k]).map((one) => one.kind + " (" + one.value + ")");
    get("words").textContent = "sweep " + s.sweep[now.k] + ", " + s.seconds[now.k].toFixed(2) + " s, " + count + (count === 1 ? " object" : " objects") + (s.tracks ? ", " + many + (many === 1 ? " agent" : " agents") : "") + ", d_th " + s.dth[now.k].toPrecision(3) + " m" + (why.length ? " \u2014 " + why.join(", ") : "");
    drawScene(s, now.k); drawRange(s, now.k); drawDifference(s, now.k); drawTimeline(s, now.k);
  }

  function choose(stream, k) {
    now.stream = stream; now.k = k;
    get("stream").value = stream;
    get("slider").max = Math.max(0, streams[stream].count - 1);
    legend(streams[stream]);
    show();
  }

  function legend(s) {
    const entries = s.raw ? [["beam of an object", BLUE], ["other beam", GREY], ["|s| > d_th", VERMILION]] : [];
    if (s.raw && s.set.includes(1)) entries.splice(1, 0, ["beam of an agent", VERMILION]);
    if (s.tracks) entries.push(["track of an object", BLUE, "circle"], ["track of an agent", VERMILION, "triangle"]);
    const seen = new Set(s.shape);
    data.shapes.forEach((name, i) => { if (seen.has(i) && name !== "wall") entries.push(["box: " + name, data.colours[i]]); });
    get("legend").replaceChildren(...entries.map(([name, colour, form]) => {
      const item = document.createElement("span"), mark = document.createElement("i");
      mark.style.background = colour;
      if (form) mark.className = form;
      item.append(mark, name);
      return item;
    }));
  }

  function stop() { clearInterval(now.timer); now.timer = null; get("play").textContent = "Play"; }

  function play() {
    if (now.timer) { stop(); return; }
    if (now.k >= streams[now.stream].count - 1) now.k = -1;
    get("play").textContent = "Stop";
    now.timer = setInterval(() => { now.k++; show(); if (now.k >= streams[now.stream].count - 1) stop(); }, 100);
  }

  function move(by) { stop(); now.k += by; show(); }

  get("slider").addEventListener("input", () => { stop(); now.k = Number(get("slider").value); show(); });
  get("stream").addEventListener("change", () => { stop(); choose(Number(get("stream").value), 0); });
  get("play").addEventListener("click", play);
  get("back").addEventListener("click", () => move(-1));
  get("forward").addEventListener("click", () => move(1));
  get("timeline").addEventListener("click", (event) => {
    const box = get("timeline").getBoundingClientRect();
    stop(); now.k = Math.floor((event.clientX - box.left) / box.width * streams[now.stream].count); show();
  });
  document.querySelectorAll(".jump").forEach((button) => button.addEventListener("click", () => {
    stop();
    const stream = Number(button.dataset.stream);
    choose(stream, place(streams[stream], Number(button.dataset.sweep)));
    get("viewer").scrollIntoView({ block: "start" });
  }));
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target.tagName === "SELECT") return;
    const steps = { ArrowLeft: -1, ArrowRight: 1, PageUp: -10, PageDown: 10, Home: -1e9, End: 1e9 };
    if (event.key in steps) { event.preventDefault(); move(steps[event.key]); }
    if (event.key === " " && event.target.tagName !== "BUTTON") { event.preventDefault(); play(); }
  });
  window.addEventListener("resize", show);
  window.addEventListener("beforeprint", show);
  if (streams.length === 1) get("stream").hidden = true;
  choose(0, 0);
})();
