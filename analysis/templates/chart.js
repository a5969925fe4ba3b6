// The light curve that one can zoom, drag, fold and question; draws on a canvas, marks in the page.
window.lcbayes = window.lcbayes || {};
(function (lcbayes) {
  "use strict";

  lcbayes.numbers = function (text, kind) {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    return new kind(bytes.buffer);
  };
  // 16-bit integers with offset and step: a function of row and column
  lcbayes.table = function (packed, columns) {
    if (!packed) return null;
    const q = lcbayes.numbers(packed.q, Uint16Array);
    return { rows: q.length / columns, at: (r, i) => packed.low + packed.step * q[r * columns + i] };
  };
  lcbayes.colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  const UNITS = [["d", 2 * 86400, 86400], ["h", 2 * 3600, 3600], ["min", 600, 60], ["s", 0, 1]];
  lcbayes.unit = (seconds) => UNITS.find((u) => seconds >= u[1]);
  // with the digits of a step, if there is one
  lcbayes.duration = function (seconds, step) {
    const [name, , size] = lcbayes.unit(Math.abs(seconds));
    if (step) return `${(seconds / size).toFixed(Math.max(0, Math.min(12, Math.ceil(-Math.log10(step / size)))))} ${name}`;
    return `${(seconds / size).toPrecision(6).replace(/(\.\d*?)0+$/, "$1").replace(/\.$/, "")} ${name}`;
  };

  function ticks(low, high, most) {
    const raw = (high - low) / Math.max(1, most), power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].map((k) => k * power).find((s) => s >= raw * 0.999);
    const found = [];
    for (let v = Math.ceil(low / step) * step; v <= high + 1e-9 * step; v += step)
      found.push(Math.abs(v) < 1e-9 * step ? 0 : v);
    return { step, values: found, text: (v) => v.toFixed(Math.max(0, Math.min(9, -Math.floor(Math.log10(step) + 1e-9)))) };
  }

  lcbayes.Chart = class {
    constructor(box, data) {
      this.box = box; this.data = data;
      this.canvas = box.querySelector("canvas"); this.pen = this.canvas.getContext("2d");
      this.tip = box.querySelector(".tip"); this.line = box.querySelector(".cursor");
      this.dot = box.querySelector(".dot-mark");
      this.mode = 0; this.draw_row = 0; this.folded = false; this.period = 1; this.listeners = [];
      this.layout(); this.reset(); this.listen();
      new ResizeObserver(() => this.paint()).observe(this.canvas);
    }

    // Segments side by side, without the gaps between them.
    layout() {
      const { t, segments } = this.data;
      const whole = segments.reduce((sum, s) => sum + (t[s.to - 1] - t[s.from]), 0) || 1;
      const least = segments.length > 1 ? whole / segments.length / 4 : whole;
      let from = 0;
      for (const s of segments) {
        s.start = from; s.length = Math.max(t[s.to - 1] - t[s.from], least);
        from += s.length + 0.18 * least;
      }
      this.whole = from - 0.18 * least;
      const steps = [];
      for (const s of segments) for (let i = s.from + 1; i < s.to; i++) steps.push(t[i] - t[i - 1]);
      steps.sort((a, b) => a - b);
      this.step = steps[steps.length >> 1] || 1;
    }
    place(i) {
      const s = this.data.segments[this.data.segmentOf[i]];
      return s.start + (this.data.t[i] - this.data.t[s.from]);
    }
    x(i) { return this.folded ? this.phase(i) : this.place(i); }
    phase(i) { const p = this.data.t[i] / this.period; return p - Math.floor(p); }
    limits() { return this.folded ? [0, 1] : [0, this.whole]; }
    reset() { const [a, b] = this.limits(), pad = 0.02 * (b - a); this.view = [a - pad, b + pad]; this.paint(); }
    show(segment) {
      const s = this.data.segments[segment], pad = 0.03 * s.length;
      this.view = [s.start - pad, s.start + s.length + pad]; this.paint();
    }
    zoom(factor, at = 0.5) {
      const [a, b] = this.view, middle = a + at * (b - a), [low, high] = this.limits();
      const width = Math.min(1.5 * (high - low), Math.max(1e-5 * (high - low), (b - a) * factor));
      this.view = [middle - at * width, middle + (1 - at) * width]; this.paint();
    }
    pan(part) {
      const width = this.view[1] - this.view[0], [low, high] = this.limits();
      const a = Math.min(high - 0.1 * width, Math.max(low - 0.9 * width, this.view[0] + part * width));
      this.view = [a, a + width]; this.paint();
    }

    // brightness as drawn: in a fold, each segment relative to its mean
    value(i) { return this.folded ? this.relative(i, this.data.y[i]) : this.data.y[i]; }
    relative(i, y) {
      const s = this.data.segments[this.data.segmentOf[i]];
      return this.data.magnitude ? y - s.mean : y / s.mean;
    }
    bands() { const m = this.data.modes[this.mode]; return m && m.bands; }
    curve() { const m = this.data.modes[this.mode]; return m && m.curves; }
    model(i) { const b = this.bands(), c = this.curve(); return b ? b.at(2, i) : c ? c.at(0, i) : NaN; }
    residual(i) {
      const r = this.data.y[i] - this.model(i), s = this.data.sigma[i];
      return s > 0 ? r / s : r;
    }

    paint() {
      const width = this.canvas.clientWidth, height = this.canvas.clientHeight;
      if (!width || !height) return;
      const ratio = window.devicePixelRatio || 1, pen = this.pen;
      this.canvas.width = Math.round(width * ratio); this.canvas.height = Math.round(height * ratio);
      pen.setTransform(ratio, 0, 0, ratio, 0, 0);
      pen.clearRect(0, 0, width, height);
      pen.font = "12px system-ui, sans-serif";
      const seen = [], n = this.data.t.length, [a, b] = this.view;
      for (let i = 0; i < n; i++) { const x = this.x(i); if (x >= a && x <= b) seen.push(i); }
      this.seen = seen;
      const below = !this.folded && Number.isFinite(this.model(0));
      this.area = { left: 58, right: width - 10, top: 10, bottom: height - 40, split: below ? height - 40 - 0.24 * (height - 50) : 0 };
      const area = this.area, bottom = below ? area.split - 10 : area.bottom;
      this.sx = (x) => area.left + (x - a) / (b - a) * (area.right - area.left);
      const range = this.range(seen);
      const up = this.data.magnitude;
      this.sy = (y) => { const f = (y - range[0]) / (range[1] - range[0]); return up ? area.top + f * (bottom - area.top) : bottom - f * (bottom - area.top); };
      const ink = lcbayes.colour("--ink"), soft = lcbayes.colour("--soft"), grid = lcbayes.colour("--line");
      this.axisY(range, bottom, soft, grid);
      this.axisX(soft, grid);
      pen.save(); pen.beginPath(); pen.rect(area.left, area.top - 4, area.right - area.left, area.bottom - area.top + 8); pen.clip();
      if (!this.folded) { this.drawBands(seen); this.drawCurve(seen); }
      this.drawPoints(seen, ink);
      if (below) this.drawResiduals(seen, ink, soft, grid);
      pen.restore();
      this.mark();
      this.canvas.dataset.view = this.view.map((v) => v.toPrecision(6)).join(" ");
    }
    range(seen) {
      let low = Infinity, high = -Infinity;
      const b = this.folded ? null : this.bands(), c = this.folded ? null : this.curve();
      for (const i of seen) {
        const y = [this.value(i)];
        if (b) y.push(b.at(0, i), b.at(4, i));
        if (c) y.push(c.at(this.draw_row, i));
        low = Math.min(low, ...y); high = Math.max(high, ...y);
      }
      if (!(high > low)) { low -= 0.5; high = low + 1; }
      const pad = 0.06 * (high - low);
      return [low - pad, high + pad];
    }
    axisY([low, high], bottom, soft, grid) {
      const pen = this.pen, area = this.area, marks = ticks(low, high, Math.max(2, (bottom - area.top) / 45));
      pen.textAlign = "right"; pen.textBaseline = "middle"; pen.lineWidth = 1;
      for (const v of marks.values) {
        const y = Math.round(this.sy(v)) + 0.5;
        pen.strokeStyle = grid; pen.beginPath(); pen.moveTo(area.left, y); pen.lineTo(area.right, y); pen.stroke();
        pen.fillStyle = soft; pen.fillText(marks.text(v), area.left - 6, y);
      }
      pen.save(); pen.translate(11, (area.top + bottom) / 2); pen.rotate(-Math.PI / 2); pen.textAlign = "center";
      const relative = this.data.magnitude ? "magnitude − mean" : "flux ÷ mean of its pass";
      pen.fillText(this.folded ? relative : this.data.label, 0, 0); pen.restore();
    }
    axisX(soft, grid) {
      const pen = this.pen, area = this.area, [a, b] = this.view;
      pen.textAlign = "center"; pen.textBaseline = "top"; pen.fillStyle = soft; pen.strokeStyle = grid;
      const across = (x) => { pen.beginPath(); pen.moveTo(x, area.top); pen.lineTo(x, area.bottom); pen.stroke(); };
      if (this.folded) {
        const marks = ticks(a, b, (area.right - area.left) / 80);
        for (const v of marks.values) { const x = Math.round(this.sx(v)) + 0.5; across(x); pen.fillText(marks.text(v), x, area.bottom + 6); }
        pen.fillText(this.data.modes[this.mode].candidates ? "cycles" : "rotations", (area.left + area.right) / 2, area.bottom + 22);
        return;
      }
      const shown = this.data.segments.filter((s) => s.start <= b && s.start + s.length >= a);
      const longest = Math.max(...shown.map((s) => Math.min(b, s.start + s.length) - Math.max(a, s.start)), 1e-9);
      const [name, , size] = lcbayes.unit(longest);
      let written = -Infinity; // right end of the labels so far
      for (const s of shown) {
        const low = Math.max(a, s.start) - s.start, high = Math.min(b, s.start + s.length) - s.start;
        const room = this.sx(s.start + high) - this.sx(s.start + low);
        if (this.data.segments.length > 1) { const x = Math.round(this.sx(s.start)) - 3.5; pen.setLineDash([2, 3]); if (x > area.left) across(x); pen.setLineDash([]); }
        if (room < 46) continue;
        const marks = ticks(low / size, Math.max(high, low + 1e-9) / size, room / 70);
        for (const v of marks.values) {
          const x = Math.round(this.sx(s.start + v * size)) + 0.5;
          const text = marks.text(v), half = pen.measureText(text).width / 2;
          across(x);
          if (x > area.left + 4 && x < area.right - 8 && x - half > written + 4) { pen.fillText(text, x, area.bottom + 6); written = x + half; }
        }
      }
      const label = `time (${name}) from the first point of each pass`, most = Math.floor((area.right - area.left) / 6);
      const whole = shown.length === 1 ? `${label} · ${shown[0].title}` : label;
      pen.fillText(whole.length > most ? label.slice(0, most) : whole, (area.left + area.right) / 2, area.bottom + 22);
    }
    // runs of visible points of one segment without a long gap
    runs(seen) {
      const found = []; let run = [];
      for (const i of seen) {
        const j = run[run.length - 1];
        if (run.length && (this.data.segmentOf[i] !== this.data.segmentOf[j] || this.data.t[i] - this.data.t[j] > 10 * this.step)) { found.push(run); run = []; }
        run.push(i);
      }
      if (run.length) found.push(run);
      return found;
    }
    drawBands(seen) {
      const b = this.bands(), pen = this.pen;
      if (!b) return;
      const hue = this.data.modes[this.mode].colour;
      for (const run of this.runs(seen)) for (const [low, high, alpha] of [[0, 4, 0.2], [1, 3, 0.36]]) {
        pen.globalAlpha = alpha; pen.fillStyle = hue; pen.beginPath();
        if (run.length === 1) pen.rect(this.sx(this.x(run[0])) - 2, Math.min(this.sy(b.at(low, run[0])), this.sy(b.at(high, run[0]))), 4, Math.abs(this.sy(b.at(low, run[0])) - this.sy(b.at(high, run[0]))));
        run.forEach((i, k) => pen[k ? "lineTo" : "moveTo"](this.sx(this.x(i)), this.sy(b.at(high, i))));
        for (let k = run.length - 1; k >= 0; k--) pen.lineTo(this.sx(this.x(run[k])), this.sy(b.at(low, run[k])));
        pen.fill(); pen.globalAlpha = 1;
      }
    }
    drawCurve(seen) {
      const c = this.curve(), pen = this.pen;
      if (!c) return;
      pen.strokeStyle = lcbayes.colour("--draw"); pen.lineWidth = 1.6;
      for (const run of this.runs(seen)) {
        pen.beginPath();
        run.forEach((i, k) => pen[k ? "lineTo" : "moveTo"](this.sx(this.x(i)), this.sy(c.at(this.draw_row, i))));
        pen.stroke();
      }
    }
    drawPoints(seen, ink) {
      const pen = this.pen, error = this.data.error, size = seen.length > 600 ? 1.4 : 2.2;
      if (!this.folded && seen.length <= 600) {
        pen.strokeStyle = ink; pen.globalAlpha = 0.35; pen.lineWidth = 1; pen.beginPath();
        for (const i of seen) if (error[i] > 0) { const x = this.sx(this.x(i)); pen.moveTo(x, this.sy(this.data.y[i] - error[i])); pen.lineTo(x, this.sy(this.data.y[i] + error[i])); }
        pen.stroke(); pen.globalAlpha = 1;
      }
      const few = this.data.segments.length <= lcbayes.HUES.length;
      const [low, high] = this.data.phaseRange;
      for (const i of seen) {
        pen.fillStyle = !this.folded ? ink : few ? lcbayes.HUES[this.data.segmentOf[i]] : lcbayes.scale((this.data.phase[i] - low) / (high - low || 1));
        pen.beginPath(); pen.arc(this.sx(this.x(i)), this.sy(this.value(i)), size, 0, 6.3); pen.fill();
      }
    }
    drawResiduals(seen, ink, soft, grid) {
      const pen = this.pen, area = this.area, hue = this.data.modes[this.mode].colour;
      const known = this.data.sigma[0] > 0;
      let most = 0;
      for (const i of seen) most = Math.max(most, Math.abs(this.residual(i)));
      most = known ? Math.min(6, Math.max(3.2, 1.1 * most)) : 1.1 * most || 1;
      const sign = this.data.magnitude ? 1 : -1, middle = (area.split + area.bottom) / 2;
      const sy = (r) => middle + sign * Math.max(-1, Math.min(1, r / most)) * (area.bottom - area.split) / 2;
      if (known) { pen.globalAlpha = 0.16; pen.fillStyle = hue; pen.fillRect(area.left, sy(1.645 * -sign), area.right - area.left, sy(1.645 * sign) - sy(-1.645 * sign)); pen.globalAlpha = 1; }
      pen.strokeStyle = soft; pen.lineWidth = 1; pen.beginPath(); pen.moveTo(area.left, middle); pen.lineTo(area.right, middle); pen.stroke();
      for (const i of seen) {
        const r = this.residual(i);
        pen.fillStyle = Math.abs(r) > most ? lcbayes.colour("--alarm") : ink;
        pen.beginPath(); pen.arc(this.sx(this.x(i)), sy(r), 1.5, 0, 6.3); pen.fill();
      }
      pen.restore(); pen.save();
      pen.fillStyle = soft; pen.textAlign = "right"; pen.textBaseline = "middle";
      for (const r of known ? [-3, 0, 3] : [0]) pen.fillText(r, area.left - 6, sy(r));
      pen.translate(11, middle); pen.rotate(-Math.PI / 2); pen.textAlign = "center"; pen.fillText(known ? "resid. (σ)" : "resid.", 0, 0);
    }

    // the cursor, an element of the page so that it moves without painting
    mark() {
      if (!this.area) return;  // not laid out yet
      const x = this.cursor === undefined ? NaN : this.sx(this.x(this.cursor));
      const inside = x >= this.area.left && x <= this.area.right;
      this.line.hidden = !inside;
      if (inside) { this.line.style.transform = `translateX(${x}px)`; this.line.style.top = `${this.area.top}px`; this.line.style.height = `${this.area.bottom - this.area.top}px`; }
    }
    moveTo(i) { this.cursor = i; this.mark(); }
    nearest(px, py) {
      let best = -1, least = 1600;  // 40 px away at most
      for (const i of this.seen) {
        const d = (this.sx(this.x(i)) - px) ** 2 + (py === undefined ? 0 : 0.02 * (this.sy(this.value(i)) - py) ** 2);
        if (d < least || (py === undefined && best < 0)) { least = d; best = i; }
      }
      return best;
    }
    words(i) {
      const d = this.data, s = d.segments[d.segmentOf[i]], lines = [s.title];
      if (d.epoch) lines.push(new Date((d.epoch + d.t[i] / 86400 - 2440587.5) * 864e5).toISOString().replace("T", " ").slice(0, 21) + " UTC");
      lines.push(`t = ${lcbayes.duration(d.t[i] - d.t[s.from])}` + (this.folded ? `, rotation ${this.phase(i).toFixed(3)}` : ""));
      const error = d.error[i] > 0 ? ` ± ${d.error[i].toPrecision(2)}` : "";
      lines.push(`${d.label}: ${d.y[i].toPrecision(5)}${error}`);
      if (Number.isFinite(this.model(i))) lines.push(`residual ${this.residual(i).toPrecision(3)}${d.sigma[i] > 0 ? " σ" : ""}`);
      if (d.sites[d.site[i]]) lines.push(`site ${d.sites[d.site[i]]}`);
      if (Number.isFinite(d.phase[i])) lines.push(`phase angle ${d.phase[i].toFixed(1)}°`);
      return lines;
    }
    hover(px, py) {
      const i = this.nearest(px, py);
      this.tip.hidden = this.dot.hidden = i < 0;
      if (i < 0) return;
      this.tip.replaceChildren(...this.words(i).map((text) => Object.assign(document.createElement("div"), { textContent: text })));
      const x = this.sx(this.x(i)), y = this.sy(this.value(i)), wide = this.tip.offsetWidth;
      this.tip.style.left = `${Math.max(0, x + 14 + wide > this.canvas.clientWidth ? x - wide - 14 : x + 14)}px`;
      this.tip.style.top = `${Math.max(0, y - 20)}px`;
      this.dot.style.transform = `translate(${x - 5}px, ${y - 5}px)`;
    }
    listen() {
      const c = this.canvas, held = new Map();
      let moved = 0, gap = 0;
      const at = (e) => { const r = c.getBoundingClientRect(); return [e.clientX - r.left, e.clientY - r.top]; };
      const part = (x) => (x - this.area.left) / (this.area.right - this.area.left);
      c.addEventListener("pointerdown", (e) => {
        held.set(e.pointerId, at(e)); moved = 0; gap = 0;
        try { c.setPointerCapture(e.pointerId); } catch (_) { /* a pointer that is gone */ }
      });
      c.addEventListener("pointermove", (e) => {
        const now = at(e), before = held.get(e.pointerId);
        if (!before) { this.hover(...now); return; }
        held.set(e.pointerId, now);
        if (held.size === 2) {
          const [p, q] = [...held.values()], wide = Math.abs(p[0] - q[0]);
          if (gap && wide > 10) this.zoom(gap / wide, part((p[0] + q[0]) / 2));
          gap = wide;
        } else {
          moved += Math.abs(now[0] - before[0]);
          this.pan(-(now[0] - before[0]) / (this.area.right - this.area.left));
        }
      });
      for (const name of ["pointerup", "pointercancel"]) c.addEventListener(name, (e) => {
        const x = held.get(e.pointerId); held.delete(e.pointerId);
        if (x && moved < 4 && name === "pointerup") { const i = this.nearest(...x); if (i >= 0) { this.hover(...x); for (const f of this.listeners) f(i); } }
      });
      c.addEventListener("pointerleave", () => { this.tip.hidden = this.dot.hidden = true; });
      c.addEventListener("wheel", (e) => {
        if (!(e.ctrlKey || e.metaKey || document.activeElement === c)) return;  // else the page scrolls
        e.preventDefault(); this.zoom(Math.exp(0.0015 * e.deltaY), part(at(e)[0]));
      }, { passive: false });
      c.addEventListener("dblclick", () => this.reset());
      c.addEventListener("keydown", (e) => {
        const does = { ArrowLeft: () => this.pan(-0.1), ArrowRight: () => this.pan(0.1), "+": () => this.zoom(0.7), "=": () => this.zoom(0.7), "-": () => this.zoom(1.4), Home: () => this.reset() }[e.key];
        if (does) { e.preventDefault(); does(); }
      });
    }
  };

  // colours of passes as in the figures, and a scale from dark blue to yellow (as cividis)
  lcbayes.HUES = ["#3b8fd4", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#8a8a8a"];
  const STOPS = [[0, 48, 112], [60, 80, 110], [124, 123, 120], [188, 173, 108], [253, 231, 55]];
  lcbayes.rgb = function (part) {
    const x = 4 * Math.max(0, Math.min(1, part || 0)), k = Math.min(3, Math.floor(x));
    return STOPS[k].map((c, j) => c + (x - k) * (STOPS[k + 1][j] - c));
  };
  lcbayes.scale = (part) => `rgb(${lcbayes.rgb(part).map(Math.round).join(",")})`;
})(window.lcbayes);
