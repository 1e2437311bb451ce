// What is shown now, and everything that changes it: buttons, keys, the address of the page.
const streams = data.streams.map(unpack);
streams.forEach(measure);
const now = { stream: 0, k: 0, timer: null, world: false, chosen: null, paper: false, late: null };

function sceneNow() {
  const s = streams[now.stream];
  return { s: s, k: now.k, world: now.world, view: viewOf(s), chosen: chosenRow(s, now.k) };
}

function show() {
  const s = streams[now.stream], k = now.k, colours = coloursOf(now.paper);
  get("slider").value = s.seconds[k];
  const words = wordsOf(s, k);
  get("words").textContent = words;
  get("slider").setAttribute("aria-valuetext", words);
  const { pen, width, height } = open("scene");
  drawScene(pen, width, height, sceneNow(), colours);
  get("scene").style.touchAction = isZoomed() ? "none" : "pan-y";
  if (s.raw) { drawRange(s, k, colours); drawDifference(s, k, colours); }
  drawTimeline(s, k, colours);
  drawZones(s, k, colours);
  showDetails(s, k);
}

function wordsOf(s, k) {
  const counted = (value, name) => value + " " + name + (value === 1 ? "" : "s");
  const parts = ["sweep " + s.sweep[k], timeWords(s, s.seconds[k]), counted(s.objects[k], "object") + (s.tracks ? " (" + s.agents[k] + " of agents)" : "")];
  if (!isNaN(s.d_th[k])) parts.push("threshold d_th " + s.d_th[k].toPrecision(3) + " m");
  const why = data.standing.filter((one) => one.stream === now.stream && one.sweep === s.sweep[k]).map((one) => one.kind + " (" + one.value + ")");
  return parts.join(", ") + (why.length ? " \u2014 " + why.join(", ") : "");
}

// Another stream: its panels, legend and slider.
function enter(stream) {
  const s = streams[stream];
  if (stream !== now.stream) now.chosen = null;
  now.stream = stream;
  now.world = now.world && Boolean(s.pose);
  get("stream").value = stream;
  get("world").value = now.world ? "world" : "sensor";
  get("world").hidden = !s.pose;
  get("slider").min = s.first; get("slider").max = s.last;
  get("panels").classList.toggle("boxes", !s.raw);
  get("save-beams").hidden = get("save-beams").disabled = !s.raw;
  legend(s);
}

function legend(s) {
  const entries = [], has = (set) => s.set.includes(set);
  if (s.raw) {
    if (has(OBJECT)) entries.push(["beam on an object", "blue"]);
    if (has(AGENT)) entries.push(["beam on an agent", "vermilion"]);
    entries.push(["beam on walls and rest", "grey"], ["|s| > d_th", "vermilion", "stem"]);
  }
  const tracked = (set) => s.tracks && s.set.some((one, j) => one === set && s.tracks.track[j] > 0);
  if (tracked(OBJECT)) entries.push(["track of an object", "blue", "circle"]);
  if (tracked(AGENT)) entries.push(["track of an agent", "vermilion", "triangle"]);
  if (s.pose) entries.push(["path of the sensor (world frame)", "green", "stem"]);
  if (s.pose && data.map) entries.push(["map (world frame)", "light"]);
  const shapes = new Set(s.shape.filter((_, j) => s.set[j] !== REST));
  data.shapes.forEach((name, i) => { if (shapes.has(i)) entries.push(["box: " + name, "shape-" + name, "frame"]); });
  get("legend").replaceChildren(...entries.map(([name, colour, form]) => {
    const item = document.createElement("span"), mark = document.createElement("i");
    mark.style.color = "var(--" + colour + ")";
    if (form) mark.className = form;
    item.append(mark, name);
    return item;
  }));
}

// Everything that a user does to get to another sweep comes through here.
function moveTo(k) {
  now.k = Math.max(0, Math.min(streams[now.stream].count - 1, k));
  show();
  clearTimeout(now.late);
  // A browser takes offence at addresses that change with each frame.
  now.late = setTimeout(writeAddress, 250);
}

function jump(k) { stop(); moveTo(k); }

function stop() { clearInterval(now.timer); now.timer = null; get("play").textContent = "Play"; }

function play() {
  const last = streams[now.stream].count - 1;
  if (now.timer) { stop(); return; }
  if (now.k >= last) now.k = -1;
  get("play").textContent = "Stop";
  now.timer = setInterval(() => { moveTo(now.k + 1); if (now.k >= last) stop(); }, 100);
}

// The address names a sweep: #sweep=34, with the log, topic and frame where there are several, and who is chosen.
function writeAddress() {
  const s = streams[now.stream], parts = [["sweep", s.sweep[now.k]]];
  for (const name of ["log", "topic", "frame"]) if (streams.some((one) => one[name] !== s[name])) parts.push([name, s[name]]);
  if (now.world) parts.push(["view", "world"]);
  if (now.chosen) parts.push(...Object.entries(now.chosen));
  const words = parts.map(([name, value]) => name + "=" + encodeURIComponent(value).replace(/%2F/g, "/")).join("&");
  history.replaceState(null, "", "#" + words);
}

function readAddress() {
  const wanted = new URLSearchParams(location.hash.slice(1).replace(/\+/g, "%2B"));
  if (!wanted.has("sweep")) return false;
  const fits = (one) => ["log", "topic", "frame"].every((name) => !wanted.has(name) || one[name] === wanted.get(name));
  stop();
  now.world = wanted.get("view") === "world";
  enter(Math.max(0, streams.findIndex(fits)));
  const name = ["track", "object"].find((one) => wanted.has(one));
  now.chosen = name ? { [name]: Number(wanted.get(name)) } : null;
  now.k = place(streams[now.stream], Number(wanted.get("sweep")) || 0);
  show();
  return true;
}

// The next of the objects of this sweep.
function chooseNext() {
  const s = streams[now.stream], rows = members(s, now.k);
  choose(rows.length ? rows[(rows.indexOf(chosenRow(s, now.k)) + 1) % rows.length] : -1);
  moveTo(now.k);
}

function startKeys() {
  const steps = { ArrowLeft: -1, ArrowRight: 1, PageUp: -10, PageDown: 10, Home: -Infinity, End: Infinity };
  const others = {
    n: chooseNext, Escape: () => { choose(-1); moveTo(now.k); },
    "+": () => zoom(0.7), "-": () => zoom(1 / 0.7), 0: unzoom,
  };
  document.addEventListener("keydown", (event) => {
    const at = get("viewer").getBoundingClientRect();
    // Below, keys are those of the page.
    if (event.ctrlKey || event.altKey || event.metaKey || event.target.tagName === "SELECT" || at.bottom < 0) return;
    if (event.key in steps) { event.preventDefault(); jump(now.k + steps[event.key]); }
    else if (event.key in others) others[event.key]();
    else if (event.key === " " && event.target.tagName !== "BUTTON") { event.preventDefault(); play(); }
  });
}

function start() {
  startTimeline(); startLooking(); startSaving(); startKeys();
  get("stream").addEventListener("change", () => { enter(Number(get("stream").value)); jump(0); });
  get("play").addEventListener("click", play);
  get("back").addEventListener("click", () => jump(now.k - 1));
  get("forward").addEventListener("click", () => jump(now.k + 1));
  document.querySelectorAll(".jump").forEach((button) => button.addEventListener("click", () => {
    enter(Number(button.dataset.stream));
    jump(place(streams[now.stream], Number(button.dataset.sweep)));
    get("viewer").scrollIntoView({ block: "start" });
  }));
  // On paper pictures stay as they were drawn last.
  const all = () => { show(); drawCharts(); };
  const redraw = () => { if (!now.paper) all(); };
  window.addEventListener("resize", redraw);
  window.addEventListener("hashchange", readAddress);
  window.addEventListener("beforeprint", () => { now.paper = true; all(); });
  window.addEventListener("afterprint", () => { now.paper = false; all(); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  get("stream").hidden = streams.length === 1;
  if (!readAddress()) { enter(0); show(); }
  drawCharts();
}

start();
