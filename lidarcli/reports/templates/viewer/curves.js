// Axes with their numbers and labels on a canvas; what is drawn on it places its values by X and Y.
function plane(id, labels, [x0, x1], [y0, y1], edge, colours) {
  const { pen, width, height } = open(id), right = width - edge.right, bottom = height - edge.bottom;
  const X = (x) => edge.left + (x - x0) / (x1 - x0) * (right - edge.left);
  const Y = (y) => bottom - (y - y0) / (y1 - y0) * (bottom - edge.top);
  const whole = (marks, only) => (only ? marks.filter(([value]) => Number.isInteger(value)) : marks);
  pen.strokeStyle = colours.grid; pen.fillStyle = colours.quiet; pen.lineWidth = 1;
  pen.textAlign = "right";
  for (const [y, text] of whole(ticks(y0, y1, 5), labels.whole_y)) { line(pen, edge.left, Y(y), right, Y(y)); pen.fillText(text, edge.left - 5, Y(y) + 4); }
  pen.textAlign = "center";
  let marks = whole(ticks(x0, x1, width / 70), labels.whole_x);
  if (labels.step) for (marks = []; marks.length <= (x1 - x0) / labels.step; ) marks.push([x0 + marks.length * labels.step, x0 + marks.length * labels.step]);
  for (const [x, text] of marks) { line(pen, X(x), bottom, X(x), bottom + 4); pen.fillText(text, Math.min(X(x), width - 14), bottom + 16); }
  if (labels.x) { pen.textAlign = "right"; pen.fillText(labels.x, right, height - 3); }
  pen.textAlign = "start"; pen.fillText(labels.y, 4, 10);
  return { pen: pen, X: X, Y: Y, left: edge.left, width: width };
}

// r(theta) and s(theta) of one sweep.
function curves(id, s, k, low, high, colours) {
  const { pen, width, height } = open(id), v = s.curves;
  const left = 40, bottom = height - 20, top = 14;
  const X = (theta) => left + (theta - v.low) / (v.high - v.low) * (width - left - 6);
  const Y = (value) => bottom - (value - low) / (high - low) * (bottom - top);
  pen.fillStyle = colours.shade;
  for (const j of members(s, k)) {
    const slack = Math.abs(s.raw.angle_increment[k]) / 2, length = (s.theta_f[j] - s.theta_i[j]) / data.angle;
    const from = v.low + ((s.theta_i[j] / data.angle - v.low + 1e-4) % TURN + TURN) % TURN;
    for (const shift of [0, -TURN]) {
      const a = Math.max(v.low - slack, from + shift - slack), b = Math.min(v.high + slack, from + shift + length + slack);
      if (b > a) pen.fillRect(X(a), top, Math.max(X(b) - X(a), 1.5), bottom - top);
    }
  }
  pen.strokeStyle = colours.grid; pen.fillStyle = colours.quiet; pen.lineWidth = 1;
  pen.textAlign = "right";
  for (const [t, text] of ticks(low, high, 5)) { line(pen, left, Y(t), width, Y(t)); pen.fillText(text, left - 5, Y(t) + 4); }
  pen.textAlign = "center";
  const wide = (v.high - v.low) * DEGREES > 200 ? 90 : 30;
  for (let t = Math.ceil((v.low * DEGREES - 0.5) / wide) * wide; t <= v.high * DEGREES + 0.5; t += wide) {
    line(pen, X(t / DEGREES), bottom, X(t / DEGREES), bottom + 4);
    pen.fillText(t + "\u00b0", Math.min(X(t / DEGREES), width - 14), bottom + 16);
  }
  pen.textAlign = "start"; pen.fillText(id === "range" ? "r [m]" : "s [m]", 4, 10);
  return { pen: pen, X: X, Y: Y, left: left, width: width };
}

function drawRange(s, k, colours) {
  const { pen, X, Y } = curves("range", s, k, 0, s.curves.reach, colours), sweep = beams(s, k);
  for (let n = 0; n < sweep.r.length; n++) {
    if (isNaN(sweep.r[n])) continue;
    const j = owner(s, k, sweep.theta[n]);
    pen.fillStyle = ofOwner(s, j, colours);
    dot(pen, X(sweep.theta[n]), Y(sweep.r[n]), j < 0 ? 1.1 : 1.8);
  }
}

function drawDifference(s, k, colours) {
  const { pen, X, Y, left, width } = curves("difference", s, k, -s.curves.jump, s.curves.jump, colours);
  const limit = s.d_th[k], sweep = beams(s, k);
  for (let n = 0; n < sweep.s.length; n++) {
    if (isNaN(sweep.s[n])) continue;
    const beyond = Math.abs(sweep.s[n]) > limit;
    pen.strokeStyle = pen.fillStyle = beyond ? colours.vermilion : colours.grey;
    pen.lineWidth = beyond ? 1.4 : 1;
    line(pen, X(sweep.theta[n]), Y(0), X(sweep.theta[n]), Y(sweep.s[n]));
    if (beyond) dot(pen, X(sweep.theta[n]), Y(sweep.s[n]), 2);
  }
  pen.strokeStyle = colours.ink; pen.lineWidth = 0.7; line(pen, left, Y(0), width, Y(0));
  pen.strokeStyle = colours.blue; pen.lineWidth = 1; pen.setLineDash([5, 3]);
  line(pen, left, Y(limit), width, Y(limit)); line(pen, left, Y(-limit), width, Y(-limit));
  pen.setLineDash([]);
}
