// The charts of one episode, joint by joint. They share one range of steps and one cursor.

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
