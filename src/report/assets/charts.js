// The charts of one episode: for each joint its raw action with the state's measure, the changes with masks and
// boundaries, and the action in the colours of its composite actions. They share one range of steps and one cursor.

const AXIS_WIDTH = () => (innerWidth < 600 ? 40 : 52);

/** Height of the name of an axis. */
const AXIS_LABEL = 14;

/** Few distinct values are held from step to step; many are joined by lines. */
const MAX_HELD = 12;

class EpisodeCharts {
  constructor(trace, onStep) {
    this.trace = trace;
    this.onStep = onStep;
    this.charts = [];
    this.range = this.whole();
    this.point = -1;
    this.isMoving = false;
  }

  whole() {
    return [0, Math.max(1, this.trace.nSteps - 1)];
  }

  destroy() {
    for (const { plot } of this.charts) plot.destroy();
    this.charts = [];
  }

  /** Draws the wanted kinds for the wanted joints into `place`. */
  draw(place, kinds, joints) {
    this.destroy();
    place.replaceChildren();
    const width = Math.max(240, place.clientWidth);
    const makers = { raw: rawChart, change: changeChart, segments: segmentsChart };
    for (const joint of joints) {
      place.append(element("h4", {}, jointName(joint)));
      for (const kind of kinds) {
        const made = makers[kind](this.trace, joint);
        if (made) this.add(place, width, joint, made);
      }
    }
    this.showStep(this.point);
  }

  add(place, width, joint, { title, height, options, values }) {
    const box = element("div", {
      class: "chart", tabindex: 0, role: "slider", "aria-label": `${title}, ${jointName(joint)}`, "aria-orientation": "horizontal",
      "aria-valuemin": 0, "aria-valuemax": this.trace.nSteps - 1, "aria-valuenow": 0, "aria-valuetext": "no step chosen",
    });
    place.append(element("p", { class: "chart-title" }, withSymbols(title)), box);
    const plot = new uPlot(
      {
        width, height, legend: { show: false },
        padding: [8, options.hasRightAxis ? 0 : AXIS_WIDTH() + AXIS_LABEL, 0, 0],
        cursor: { drag: { x: true, y: false, setScale: false }, points: { size: 6 }, bind: { dblclick: () => () => this.zoom(...this.whole()), mousemove: ifMoved, mouseenter: ifMoved } },
        ...options,
        scales: { x: { time: false, range: () => this.range }, ...options.scales },
        hooks: {
          ...options.hooks,
          setCursor: [(u) => { if (!this.isMoving && u.cursor.idx !== null && u.cursor.left >= 0) this.moveTo(u.cursor.idx, joint); }],
          setSelect: [(u) => this.selected(u)],
        },
      },
      [this.trace.steps, ...values],
      box,
    );
    this.charts.push({ plot, joint, box });
    box.addEventListener("keydown", (event) => this.key(event, joint));
    plot.over.addEventListener("pointermove", (event) => {
      if (event.pointerType !== "touch") return;
      const idx = plot.posToIdx(event.clientX - plot.over.getBoundingClientRect().left);
      this.moveTo(idx, joint);
    });
  }

  selected(u) {
    if (u.select.width < 4) return;
    const [left, right] = [u.select.left, u.select.left + u.select.width].map((x) => u.posToVal(x, "x"));
    u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    this.zoom(left, right);
  }

  zoom(from, to) {
    const [low, high] = this.whole();
    const size = Math.min(high - low, Math.max(2 * this.trace.stride, 2, to - from));
    const start = Math.min(Math.max(low, from), high - size);
    this.range = [start, start + size];
    // At once, not when the browser has time: what follows asks where on the new scale a step is.
    this.isMoving = true;
    for (const { plot } of this.charts) plot.batch(() => plot.setScale("x", { min: this.range[0], max: this.range[1] }));
    this.isMoving = false;
    this.showStep(this.point);
    this.onStep(this.point, this.joint || this.trace.joints[0], this.range);
  }

  zoomBy(factor) {
    const [from, to] = this.range;
    const middle = this.point >= 0 ? this.trace.steps[this.point] : (from + to) / 2;
    const size = (to - from) * factor;
    this.zoom(middle - size / 2, middle + size / 2);
  }

  pan(share) {
    const size = this.range[1] - this.range[0];
    this.zoom(this.range[0] + share * size, this.range[1] + share * size);
  }

  /** Chooses a point of the traces, and tells of it. */
  moveTo(point, joint) {
    this.point = Math.min(Math.max(0, point), this.trace.steps.length - 1);
    this.joint = joint;
    this.showStep(this.point);
    this.onStep(this.point, joint, this.range);
  }

  showStep(point) {
    if (point < 0) return;
    this.isMoving = true;
    const step = this.trace.steps[point];
    for (const { plot } of this.charts) {
      const isInside = step >= this.range[0] && step <= this.range[1];
      plot.setCursor({ left: isInside ? plot.valToPos(step, "x") : -10, top: 10 });
    }
    this.isMoving = false;
  }

  /** What a screen reader says of a chart. */
  say(joint, text) {
    for (const chart of this.charts) {
      if (chart.joint !== joint) continue;
      chart.box.setAttribute("aria-valuenow", this.trace.steps[this.point]);
      chart.box.setAttribute("aria-valuetext", text);
    }
  }

  key(event, joint) {
    const { steps } = this.trace;
    const from = this.point < 0 ? 0 : this.point;
    const leap = event.shiftKey ? 10 : 1;
    const actions = {
      ArrowLeft: () => this.moveTo(from - leap, joint),
      ArrowRight: () => this.moveTo(from + leap, joint),
      ArrowDown: () => this.moveTo(from - leap, joint),
      ArrowUp: () => this.moveTo(from + leap, joint),
      Home: () => this.moveTo(0, joint),
      End: () => this.moveTo(steps.length - 1, joint),
      PageUp: () => this.nextSegment(from, joint, -1),
      PageDown: () => this.nextSegment(from, joint, 1),
      "+": () => this.zoomBy(0.5),
      "-": () => this.zoomBy(2),
      0: () => this.zoom(...this.whole()),
      Escape: () => this.zoom(...this.whole()),
    };
    if (!actions[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    actions[event.key]();
    const step = steps[this.point < 0 ? 0 : this.point];
    const size = this.range[1] - this.range[0];
    if (step < this.range[0] || step > this.range[1]) this.zoom(step - size / 2, step + size / 2);
  }

  nextSegment(point, joint, direction) {
    const step = this.trace.steps[point];
    const starts = joint.segments.map((s) => s.start);
    const next = direction > 0 ? starts.find((s) => s > step) : starts.findLast((s) => s < step);
    if (next !== undefined) this.moveTo(Math.round(next / this.trace.stride), joint);
  }
}

/** Where the mouse was last seen. */
const mouse = { x: NaN, y: NaN };

for (const type of ["mousemove", "click"]) {
  addEventListener(type, (event) => Object.assign(mouse, { x: event.clientX, y: event.clientY }));
}

/** Charts that are scrolled under a resting mouse must not take the cursor from the step that a link has chosen. */
function ifMoved(_, __, handler) {
  return (event) => {
    if (event.clientX !== mouse.x || event.clientY !== mouse.y) handler(event);
  };
}

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
