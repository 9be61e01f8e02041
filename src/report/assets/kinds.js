// The three kinds of chart: a joint's raw action with the state's measure, the changes with masks and boundaries, and
// the action in the colours of its composite actions.

const AXIS_WIDTH = () => (innerWidth < 600 ? 40 : 52);

/** Height of the name of an axis. */
const AXIS_LABEL = 14;

/** Few distinct values are held from step to step; many are joined by lines. */
const MAX_HELD = 12;

function axis(more) {
  const font = `11px ${getComputedStyle(document.body).fontFamily}`;
  return { stroke: colour("muted"), font, labelFont: font, labelSize: AXIS_LABEL, labelGap: 0, size: AXIS_WIDTH(), grid: { stroke: colour("line"), width: 1 }, ticks: { stroke: colour("line"), width: 1, size: 4 }, gap: 4, ...more };
}

/** The axis of steps, which only the last chart of a joint needs. */
function stepAxis(isNamed) {
  return axis({ size: 20, label: isNamed ? "step" : undefined, space: 60, values: (_, ticks) => ticks.map((t) => (Number.isInteger(t) ? whole(t) : "")) });
}

function valueAxis(label, more) {
  return axis({ label, space: 28, values: (_, ticks) => ticks.map((t) => number(t)), ...more });
}

/** A range with a margin, also around a single value. */
function padded(_, low, high) {
  if (low === null || high === null || low === undefined) return [0, 1];
  const margin = high > low ? (high - low) * 0.08 : Math.max(Math.abs(low), 1) * 0.5;
  return [low - margin, high + margin];
}

function isHeld(values) {
  return new Set(values).size <= MAX_HELD;
}

function paths(values) {
  return isHeld(values) ? uPlot.paths.stepped({ align: 1 }) : uPlot.paths.linear();
}

/** uPlot leaves a gap at null. */
function gaps(values) {
  return Array.from(values, (v) => (Number.isNaN(v) ? null : v));
}

function rawChart(trace, joint) {
  // The action alone is in (c) too.
  if (!trace.state.measure) return null;
  const series = [{}];
  const values = [];
  const axes = [stepAxis(false)];
  if (joint.action) {
    series.push({ stroke: colour("action"), width: 1.25, scale: "y", paths: paths(joint.action), points: { show: false } });
    values.push(gaps(joint.action));
    axes.push(valueAxis("action", { scale: "y" }));
  }
  const hasRightAxis = Boolean(joint.action);
  series.push({ stroke: colour("state"), width: 1.25, scale: "measure", points: { show: false } });
  values.push(gaps(trace.state.measure));
  axes.push(valueAxis("state measure", { scale: "measure", side: hasRightAxis ? 1 : 3, grid: { show: !hasRightAxis, stroke: colour("line"), width: 1 } }));
  return {
    title: `(a) ${joint.action ? "raw action, and " : ""}measure of the state (E_w)`, height: 128, values,
    options: { series, axes, hasRightAxis, scales: { y: { range: padded }, measure: { range: padded } } },
  };
}

/** Room below 0 for three bands. */
const BANDS_LOW = -0.42;

function changeChart(trace, joint) {
  if (!joint.change) return null;
  const line = (name) => ({ stroke: colour(name), width: 1.25, points: { show: false } });
  return {
    title: "(b) change (E_n) of action and state, λ, masks, correlation, boundaries", height: 168,
    values: [joint.change, trace.state.change],
    options: {
      series: [{}, line("action"), line("state")],
      axes: [stepAxis(false), valueAxis("change", { splits: () => [0, 0.5, 1] })],
      scales: { y: { range: () => [BANDS_LOW, 1.06] } },
      hooks: {
        drawClear: [(u) => drawBoundaries(u, joint)],
        draw: [(u) => drawThreshold(u), (u) => drawBands(u, trace, joint)],
      },
    },
  };
}

function segmentsChart(trace, joint) {
  // Joints that are cut together have no action of their own: its change stands for it.
  const shown = joint.action || joint.change;
  if (!shown) return null;
  return {
    title: `(c) ${joint.action ? "action" : "change of the action"}, each composite action in its colour`, height: 150, values: [gaps(shown)],
    options: {
      series: [{}, { stroke: colour("outside"), width: 1.25, paths: paths(shown), points: { show: false } }],
      axes: [stepAxis(true), valueAxis(joint.action ? "action" : "change")],
      scales: { y: { range: padded } },
      hooks: {
        drawClear: [(u) => drawTints(u, joint)],
        drawSeries: [(u) => drawSegments(u, trace, joint, shown)],
      },
    },
  };
}

function inPlot(u, draw) {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  draw(ctx, bbox);
  ctx.restore();
}

function isSeen(u, start, end) {
  return end >= u.scales.x.min && start <= u.scales.x.max;
}

function drawTints(u, joint) {
  inPlot(u, (ctx, bbox) => {
    ctx.globalAlpha = Number(colour("tint"));
    joint.segments.forEach(({ start, end }, k) => {
      if (!isSeen(u, start, end)) return;
      const [left, right] = [u.valToPos(start, "x", true), u.valToPos(end, "x", true)];
      ctx.fillStyle = segmentColour(k);
      ctx.fillRect(left, bbox.top, right - left, bbox.height);
    });
  });
}

/** Draws the trace again over its composite actions, in their colours. */
function drawSegments(u, trace, joint, shown) {
  const held = isHeld(shown);
  inPlot(u, (ctx) => {
    ctx.lineWidth = 2 * devicePixelRatio;
    ctx.lineJoin = "round";
    joint.segments.forEach(({ start, end }, k) => {
      if (!isSeen(u, start, end)) return;
      ctx.strokeStyle = segmentColour(k);
      ctx.beginPath();
      const first = Math.ceil(start / trace.stride);
      const last = Math.min(Math.ceil(end / trace.stride), shown.length - 1);
      let before = NaN;
      for (let i = first; i <= last; i++) {
        const isEnd = trace.steps[i] >= end;
        if (Number.isNaN(shown[i]) && !isEnd) continue;
        const x = u.valToPos(trace.steps[i], "x", true);
        const y = Number.isNaN(shown[i]) ? before : u.valToPos(shown[i], "y", true);
        if (i === first) ctx.moveTo(x, y);
        else {
          if (held) ctx.lineTo(x, before);
          if (!(held && isEnd)) ctx.lineTo(x, y);
        }
        before = y;
      }
      ctx.stroke();
    });
  });
}

function drawBoundaries(u, joint) {
  inPlot(u, (ctx, bbox) => {
    ctx.strokeStyle = colour("rule");
    ctx.globalAlpha = 0.55;
    ctx.lineWidth = devicePixelRatio;
    const bottom = u.valToPos(0, "y", true);
    ctx.beginPath();
    for (const step of joint.boundaries) {
      if (!isSeen(u, step, step)) continue;
      const x = u.valToPos(step, "x", true);
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bottom);
    }
    ctx.stroke();
  });
}

function drawThreshold(u) {
  if (data.threshold === null) return;
  inPlot(u, (ctx, bbox) => {
    const y = u.valToPos(data.threshold, "y", true);
    ctx.strokeStyle = colour("text");
    ctx.lineWidth = devicePixelRatio;
    ctx.setLineDash([5 * devicePixelRatio, 4 * devicePixelRatio]);
    ctx.beginPath();
    ctx.moveTo(bbox.left, y);
    ctx.lineTo(bbox.left + bbox.width, y);
    ctx.stroke();
  });
  // Beside the plot, where no line crosses it.
  u.ctx.save();
  u.ctx.font = `${11 * devicePixelRatio}px ${getComputedStyle(document.body).fontFamily}`;
  u.ctx.fillStyle = colour("text");
  u.ctx.textAlign = "left";
  u.ctx.textBaseline = "middle";
  u.ctx.fillText(`λ = ${number(data.threshold)}`, u.bbox.left + u.bbox.width + 5 * devicePixelRatio, u.valToPos(data.threshold, "y", true));
  u.ctx.restore();
}

function drawBands(u, trace, joint) {
  const bands = [["action", joint.mask, "action"], ["state", trace.state.mask, "state"], ["both", joint.correlated, "correlated"]];
  const top = u.valToPos(-0.06, "y", true);
  const room = (u.valToPos(BANDS_LOW, "y", true) - top) / 3;
  const { ctx, bbox } = u;
  bands.forEach(([name, mask, label], row) => {
    if (!mask) return;
    const y = top + row * room;
    ctx.save();
    ctx.font = `${(innerWidth < 600 ? 9 : 10) * devicePixelRatio}px ${getComputedStyle(document.body).fontFamily}`;
    ctx.textAlign = "right";
    ctx.textBaseline = "middle";
    ctx.fillStyle = colour("muted");
    ctx.fillText(label, bbox.left - 5 * devicePixelRatio, y + room / 2);
    ctx.restore();
    inPlot(u, () => {
      ctx.fillStyle = colour("panel");
      ctx.fillRect(bbox.left, y + room * 0.12, bbox.width, room * 0.76);
      ctx.fillStyle = colour(name);
      for (let i = 0; i < mask.length; i++) {
        if (!mask[i]) continue;
        const start = i;
        while (i + 1 < mask.length && mask[i + 1]) i++;
        const [from, to] = [trace.steps[start], trace.steps[i] + trace.stride];
        if (!isSeen(u, from, to)) continue;
        const left = u.valToPos(from, "x", true);
        ctx.fillRect(left, y + room * 0.12, Math.max(1, u.valToPos(to, "x", true) - left), room * 0.76);
      }
    });
  });
}
