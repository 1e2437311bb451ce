// The sweep as a file: the scene as PNG or SVG in the colours of paper, objects and beams as CSV.
const WIDE = 900, HIGH = 760;

function save(suffix, parts, type) {
  const s = streams[now.stream], link = document.createElement("a");
  const name = [s.log, s.topic, s.sweep[now.k]].join("-").replace(/[^\w.-]+/g, "-").replace(/-+/g, "-");
  link.href = URL.createObjectURL(new Blob([parts], { type: type }));
  link.download = name + suffix;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

function drawnOn(pen) {
  const colours = coloursOf(true);
  pen.fillStyle = colours.paper; pen.fillRect(0, 0, WIDE, HIGH);
  drawScene(pen, WIDE, HIGH, sceneNow(), colours);
  const s = streams[now.stream];
  pen.fillStyle = colours.ink; pen.textAlign = "right";
  pen.fillText(s.log + " " + s.topic + ", sweep " + s.sweep[now.k] + ", " + timeWords(s, s.seconds[now.k]), WIDE - MARGIN.right, 12);
}

function saveSvg() {
  const pen = svgPen(WIDE, HIGH);
  drawnOn(pen);
  save(".svg", pen.text(), "image/svg+xml");
}

function savePng() {
  const canvas = document.createElement("canvas"), ratio = 2;
  canvas.width = WIDE * ratio; canvas.height = HIGH * ratio;
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.font = FONT;
  drawnOn(pen);
  canvas.toBlob((blob) => save(".png", blob, "image/png"));
}

function csv(rows) {
  const cell = (value) => (/[",\n\r]/.test(value) ? '"' + String(value).replace(/"/g, '""') + '"' : String(value));
  return rows.map((row) => row.map(cell).join(",") + "\r\n").join("");
}

function rounded(value, digits) { return isNaN(value) ? "" : String(Number(value.toFixed(digits))); }

// The columns are named as those of the objects table.
function objectRows(s, k) {
  const t = s.tracks;
  const head = ["sweep", "object", "set", "shape", "box_x", "box_y", "box_length", "box_width", "box_yaw", "r_min"];
  const rows = members(s, k).map((j) => [
    s.sweep[k], s.object[j], s.set[j] === AGENT ? "A" : "O", data.shapes[s.shape[j]],
    ...["box_x", "box_y", "box_length", "box_width"].map((name) => rounded(s[name][j] * s.scale, 4)),
    rounded(s.box_yaw[j] / data.angle, 4), rounded(s.r_min[j] * s.scale, 4),
    ...(t ? (t.track[j] > 0 ? [t.track[j], rounded(t.vx[j] * t.speed, 3), rounded(t.vy[j] * t.speed, 3)] : ["", "", ""]) : []),
    ...(s.thing ? [s.thing[j] === 255 ? "" : rounded(s.thing[j] / 254, 3)] : []),
    ...(s.label ? [labelOf(s, j)] : []),
  ]);
  return [[...head, ...(t ? ["track", "vx", "vy"] : []), ...(s.thing ? ["thing"] : []), ...(s.label ? ["label"] : [])], ...rows];
}

function beamRows(s, k) {
  const sweep = beams(s, k), rows = [["sweep", "beam", "theta", "r", "object"]];
  for (let n = 0; n < sweep.r.length; n++) {
    const j = isNaN(sweep.r[n]) ? -1 : owner(s, k, sweep.theta[n]);
    rows.push([s.sweep[k], n, rounded(sweep.theta[n], 6), rounded(sweep.r[n], 4), j < 0 ? "" : s.object[j]]);
  }
  return rows;
}

function startSaving() {
  get("save").addEventListener("change", () => {
    const s = streams[now.stream];
    ({
      png: savePng,
      svg: saveSvg,
      objects: () => save("-objects.csv", csv(objectRows(s, now.k)), "text/csv"),
      beams: () => save("-beams.csv", csv(beamRows(s, now.k)), "text/csv"),
    })[get("save").value]();
    get("save").value = "";
  });
}
