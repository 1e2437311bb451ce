// The charts of the run: series over time, histograms, and where objects were.
const DRAWN_BY = { band: area, steps: steps, line: curve, bars: area, outline: steps };

function drawCharts() {
  const colours = coloursOf(now.paper);
  data.charts.forEach((chart, i) => (chart.level ? drawPlaces : drawSeries)("chart" + i, chart, colours));
}

function drawSeries(id, chart, colours) {
  const values = chart.series.flatMap((one) => one.y).filter((y) => y !== null), most = 1.06 * Math.max(...values, 1e-9);
  const box = plane(id, chart, chart.span, [0, most], { left: 44, right: 10, top: 16, bottom: 32 }, colours);
  for (const one of chart.series) {
    box.pen.strokeStyle = box.pen.fillStyle = colours[one.colour]; box.pen.lineWidth = 1.4;
    box.pen.setLineDash(one.dash || []);
    DRAWN_BY[one.form](box, one);
  }
  box.pen.setLineDash([]);
}

// What is between the values and the lower ones, or zero; each holds until the next x.
function area({ pen, X, Y }, one) {
  one.y.forEach((y, i) => {
    if (y === null) return;
    const x = X(one.x[i]), next = X(i + 1 < one.x.length ? one.x[i + 1] : one.x[i]), low = one.low ? one.low[i] : 0;
    pen.fillRect(x, Y(y), next - x - (one.form === "bars" ? 0.8 : -0.3), Y(low) - Y(y));
  });
}

function steps({ pen, X, Y }, one) {
  pen.beginPath();
  one.y.forEach((y, i) => {
    if (y === null) return;
    if (i && one.y[i - 1] !== null) pen.lineTo(X(one.x[i]), Y(y)); else pen.moveTo(X(one.x[i]), Y(y));
    if (i + 1 < one.x.length) pen.lineTo(X(one.x[i + 1]), Y(y));
  });
  pen.stroke();
}

function curve({ pen, X, Y }, one) {
  pen.beginPath();
  one.y.forEach((y, i) => { if (y !== null) { if (i && one.y[i - 1] !== null) pen.lineTo(X(one.x[i]), Y(y)); else pen.moveTo(X(one.x[i]), Y(y)); } });
  pen.stroke();
}

// Cells from pale to dark by how often they had an object, over the walls; both axes have one scale.
function drawPlaces(id, chart, colours) {
  const [x0, y0, x1, y1] = chart.limits, { width, height } = open(id), edge = { left: 44, right: 10, top: 16, bottom: 32 };
  const scale = Math.min((width - edge.left - edge.right) / (x1 - x0), (height - edge.top - edge.bottom) / (y1 - y0));
  const wide = (width - edge.left - edge.right) / scale, high = (height - edge.top - edge.bottom) / scale;
  const span = (low, high, size) => [(low + high - size) / 2, (low + high + size) / 2];
  const { pen, X, Y } = plane(id, { x: "x [m]", y: "y [m]" }, span(x0, x1, wide), span(y0, y1, high), edge, colours);
  const square = (x, y, side) => pen.fillRect(X(x), Y(y + side), side * scale, side * scale);
  if (chart.walls) {
    pen.fillStyle = colours.grey;
    chart.walls.x.forEach((x, i) => square(x - chart.walls.cell / 2, chart.walls.y[i] - chart.walls.cell / 2, chart.walls.cell));
  }
  const seam = 0.06 * chart.cell;
  chart.level.forEach((level, i) => {
    pen.fillStyle = colours["heat-" + level];
    square(chart.x0 + chart.ix[i] * chart.cell + seam, chart.y0 + chart.iy[i] * chart.cell + seam, chart.cell - 2 * seam);
  });
  if (chart.sensor) { pen.fillStyle = colours.vermilion; polygon(pen, [[X(0) + 7, Y(0)], [X(0) - 5, Y(0) - 5], [X(0) - 5, Y(0) + 5]]); pen.fill(); }
}
