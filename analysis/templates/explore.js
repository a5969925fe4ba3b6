// The controls that join light curve, fold, draws and body.
(function (lcbayes) {
  "use strict";
  const source = document.getElementById("explored");
  if (!source) return;
  const data = decoded(JSON.parse(source.textContent));
  const section = document.getElementById("explore");
  const get = (name) => section.querySelector(`[data-is="${name}"]`);
  section.hidden = false;
  document.documentElement.classList.add("explored");

  function decoded(d) {
    const n = lcbayes.numbers(d.t, Float64Array).length;
    const data = {
      ...d, t: lcbayes.numbers(d.t, Float64Array), site: lcbayes.numbers(d.site, Uint16Array),
      ...Object.fromEntries(["y", "error", "sigma", "phase", "sun", "obs"].map((k) => [k, lcbayes.numbers(d[k], Float32Array)])),
      segmentOf: new Uint16Array(n),
    };
    let from = 0;
    data.segments = d.segments.map((s, k) => {
      const made = { title: s.title, from, to: from + s.n };
      data.segmentOf.fill(k, from, made.to);
      made.mean = data.y.subarray(from, made.to).reduce((a, b) => a + b, 0) / s.n || 1;
      from = made.to;
      return made;
    });
    data.phaseRange = [Math.min(...data.phase), Math.max(...data.phase)];
    data.modes = d.modes.map((m) => ({ ...m, bands: lcbayes.table(m.bands, n), curves: lcbayes.table(m.curves, n) }));
    return data;
  }

  const chart = new lcbayes.Chart(get("chart"), data);
  const body = lcbayes.player && lcbayes.player(get("body"), data);
  const state = { mode: 0, draw: 0, index: 0, playing: false };
  chart.moveTo(0);

  function options(select, names) {
    select.replaceChildren(...names.map((name, i) => new Option(name, String(i))));
    select.closest("label").hidden = names.length < 2;
  }
  options(get("mode"), data.modes.map((m) => m.name));
  options(get("segment"), ["all passes", ...data.segments.map((s) => s.title)]);

  function setMode(k) {
    state.mode = chart.mode = k;
    const m = data.modes[k];
    const draws = get("draw");
    draws.max = Math.max(0, (m.draws || 1) - 1);
    draws.closest("label").hidden = !(m.curves || (body && body.has(k)));
    get("fold").disabled = !m.periods;
    const named = m.candidates || [];
    options(get("candidate"), named.map((c) => `${c.label}: ${lcbayes.duration(c.seconds)}`));
    get("player").hidden = !(m.curves || (body && body.has(k)));
    if (!m.periods) fold(false);
    setDraw(0); setPeriod();
    if (get("body")) get("body").hidden = !(body && body.has(k));
    section.classList.toggle("with-body", Boolean(body && body.has(k)));
  }
  function setDraw(row) {
    state.draw = chart.draw_row = row; get("draw").value = row;
    get("draw-text").textContent = row ? `draw ${row + 1} of ${data.modes[state.mode].draws}` : "best of the draws";
    chart.paint(); pose();
  }
  function setPeriod() {
    const m = data.modes[state.mode];
    if (!m.periods) return;
    if (m.candidates) {  // ± 2 % about a candidate
      const p = m.candidates[Number(get("candidate").value)].seconds;
      chart.period = p * (1 + 0.02 * (Number(get("period").value) - 500) / 500) * Number(get("multiple").value);
      get("period-text").textContent = lcbayes.duration(chart.period, chart.period * 1e-6);
      if (chart.folded) chart.paint();
      return;
    }
    const p = m.periods, low = p[0], high = p[p.length - 1], middle = p[p.length >> 1];
    const margin = Math.max(high - low, 1e-6 * middle);
    const slid = low - 0.5 * margin + Number(get("period").value) / 1000 * 2 * margin;
    chart.period = slid * Number(get("multiple").value);
    const inside = p.filter((x) => x <= slid).length / p.length;
    get("period-text").textContent = `${lcbayes.duration(chart.period, margin / 30)} (posterior: ${Math.round(100 * inside)} % below)`;
    if (chart.folded) chart.paint();
  }
  function fold(on) {
    chart.folded = on; get("fold").setAttribute("aria-pressed", on);
    get("fold-controls").hidden = !on;
    get("segment").closest("label").hidden = on || data.segments.length < 2;
    chart.reset();
  }

  function pose() {
    const has = body && body.has(state.mode);
    if (has) body.pose(state.mode, state.draw, state.index);
    const i = Math.round(state.index);
    get("time").value = state.index;
    get("time-text").textContent = chart.words(Math.min(i, data.t.length - 1)).slice(0, 3).join(" · ");
  }
  function setIndex(index) {
    state.index = Math.max(0, Math.min(data.t.length - 1, index));
    chart.moveTo(Math.round(state.index)); pose();
  }
  chart.listeners.push((i) => { play(false); setIndex(i); });

  // Play: the cursor moves at an even rate through the times of a pass, then on to the next.
  let last = 0;
  function play(on) {
    state.playing = on;
    get("play").textContent = on ? "❚❚ Pause" : "▶ Play";
    get("play").setAttribute("aria-pressed", on);
    if (on) { if (state.index >= data.t.length - 1) state.index = 0; last = 0; requestAnimationFrame(step); }
  }
  function step(now) {
    if (!state.playing) return;
    const passed = last ? Math.min(0.1, (now - last) / 1000) : 0;
    last = now;
    let i = Math.floor(state.index), s = data.segments[data.segmentOf[i]];
    const p = data.modes[state.mode].periods, length = data.t[s.to - 1] - data.t[s.from];
    // a rotation in about 8 s, or the whole pass in 12 s if that is slower
    const rate = (p ? Math.min(p[p.length >> 1] / 8, length / 4) : length / 12) * Number(get("speed").value);
    const f = state.index - i, here = i + 1 < s.to ? data.t[i] + f * (data.t[i + 1] - data.t[i]) : data.t[i];
    const t = here + passed * rate;
    while (i + 1 < s.to && data.t[i + 1] <= t) i++;
    if (i + 1 >= s.to) { if (s.to >= data.t.length) { setIndex(data.t.length - 1); play(false); return; } setIndex(s.to); }
    else setIndex(i + Math.max(0, (t - data.t[i]) / (data.t[i + 1] - data.t[i])));
    requestAnimationFrame(step);
  }

  get("mode").addEventListener("change", (e) => setMode(Number(e.target.value)));
  get("segment").addEventListener("change", (e) => {
    const k = Number(e.target.value);
    if (k) { chart.show(k - 1); setIndex(data.segments[k - 1].from); } else chart.reset();
  });
  get("zoom-in").addEventListener("click", () => chart.zoom(0.6));
  get("zoom-out").addEventListener("click", () => chart.zoom(1 / 0.6));
  get("reset").addEventListener("click", () => { get("segment").value = "0"; chart.reset(); });
  get("fold").addEventListener("click", () => { setPeriod(); fold(!chart.folded); });
  get("candidate").addEventListener("input", () => { get("period").value = 500; setPeriod(); });
  for (const name of ["period", "multiple"]) get(name).addEventListener("input", setPeriod);
  get("draw").addEventListener("input", (e) => setDraw(Number(e.target.value)));
  get("time").max = data.t.length - 1;
  get("time").addEventListener("input", (e) => { play(false); setIndex(Number(e.target.value)); });
  get("play").addEventListener("click", () => play(!state.playing));
  if (body) get("colours").addEventListener("change", (e) => body.paintBy(e.target.value));
  document.addEventListener("lcbayes-theme", () => { chart.paint(); if (body) body.paint(); });
  fold(false); setMode(0); setIndex(0);
})(window.lcbayes);
