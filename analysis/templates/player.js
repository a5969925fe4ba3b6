// The body of a draw as the observer would see it: lit by the Sun, turned as at the chosen time.
(function (lcbayes) {
  "use strict";
  const STONE = [0.8, 0.81, 0.83], SIDES = 28;
  const { unit3: unit, dot3: dot, numbers } = lcbayes;
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const plus = (a, b, k) => a.map((x, i) => x + k * b[i]);

  // v turned by an angle about a unit axis
  function turned(v, axis, angle) {
    const c = Math.cos(angle), s = Math.sin(angle), w = cross(axis, v), d = dot(axis, v) * (1 - c);
    return v.map((x, i) => c * x + s * w[i] + d * axis[i]);
  }

  const part = (packed, row, size) => [...numbers(packed, Float64Array).subarray(size * row, size * (row + 1))];
  // inertial vector → body frame at t = 0, where they are the same unless the attitude is unknown
  function atStart(attitude, row) {
    if (!attitude.attitude) return (v) => v;
    const a = part(attitude.attitude, row, 9);
    return (v) => [0, 1, 2].map((j) => a[j] * v[0] + a[3 + j] * v[1] + a[6 + j] * v[2]);
  }

  // inertial vector → body frame, for a draw at a time; as the models rotate the body
  function toBody(attitude, row) {
    if (!attitude || attitude.kind === "fixed") return () => (v) => v;
    if (attitude.kind === "rate") {
      const omega = part(attitude.omega, row, 3), rate = Math.hypot(...omega), axis = unit(omega);
      const drift = attitude.drift ? part(attitude.drift, row, 1)[0] / (2 * attitude.span) : 0, m = attitude.middle;
      const start = atStart(attitude, row);
      return (t) => (v) => start(turned(v, axis, -rate * (t + drift * ((t - m) ** 2 - m * m))));
    }
    const [lon, lat, period] = numbers(attitude.pole, Float64Array).subarray(3 * row, 3 * row + 3);
    const [x, y, z] = [Math.cos(lat) * Math.cos(lon), Math.cos(lat) * Math.sin(lon), Math.sin(lat)];
    const a = 1 / Math.max(1 + x, 1e-12);
    const tilt = [[-y, 1 - a * y * y, -a * y * z], [-z, -a * y * z, 1 - a * z * z], [x, y, z]];
    return (t) => (v) => {
      const turns = (t - attitude.middle) / period, phase = 2 * Math.PI * (turns - Math.floor(turns));
      return turned(tilt.map((column) => dot(column, v)), [0, 0, 1], -phase);
    };
  }

  function discs(normals, areas) {
    const most = Math.max(...areas);
    return areas.map((area, k) => {
      const n = normals[k], small = n.map(Math.abs);
      const helper = [0, 0, 0]; helper[small.indexOf(Math.min(...small))] = 1;
      const u = unit(cross(n, helper)), v = cross(n, u), r = 0.62 * Math.sqrt(area / most);
      const p = Array.from({ length: SIDES }, (_, i) => {
        const angle = 2 * Math.PI * i / SIDES;
        return n.map((x, j) => x + r * (Math.cos(angle) * u[j] + Math.sin(angle) * v[j]));
      });
      return { p, facet: k };
    });
  }
  function solid(packed) {
    const corners = numbers(packed.vertices, Int16Array), list = numbers(packed.faces, Uint16Array);
    const sizes = numbers(packed.sizes, Uint8Array), facet = numbers(packed.facet, Uint16Array);
    let from = 0;
    return [...sizes].map((size, k) => {
      const p = [...list.subarray(from, from + size)].map((i) => [...corners.subarray(3 * i, 3 * i + 3)].map((x) => x / 32000));
      from += size;
      return { p, facet: facet[k] };
    });
  }
  const hue = (k) => { const c = lcbayes.HUES[k % lcbayes.HUES.length]; return [1, 3, 5].map((i) => parseInt(c.slice(i, i + 2), 16) / 255); };

  lcbayes.player = function (box, data) {
    if (!box || !data.modes.some((m) => m.bodies)) return null;
    const canvas = box.querySelector("canvas"), note = box.querySelector("[data-is='legend']");
    const made = new Map(), turn = { yaw: 0, pitch: 0 };
    let now = { mode: 0, row: 0, index: 0 }, by = "plain";

    function body(mode, row) {
      const key = `${mode} ${row}`;
      if (!made.has(key)) {
        const m = data.modes[mode], b = m.bodies;
        let polygons = null;
        const own = b.solids && (b.names ? Math.min(row, b.solids.length - 1) : row);  // one for all draws, if its lengths are known
        if (b.solids) polygons = b.solids[own] && solid(b.solids[own]);
        else {
          const areas = numbers(b.areas, Float32Array), normals = numbers(b.normals, Float32Array), n = b.uncertainty.length;
          polygons = discs(Array.from({ length: n }, (_, k) => [...normals.subarray(3 * (row * n + k), 3 * (row * n + k) + 3)]),
            [...areas.subarray(row * n, row * n + n)]);
        }
        const given = m.attitude && m.attitude.kind === "directions", at = given && !m.attitude.shared ? row : 0;
        const directions = (name) => numbers(m.attitude[name], Int16Array).subarray(3 * at * data.t.length, 3 * (at + 1) * data.t.length);
        const blocking = b.blocking ? solid(b.blocking[own]).map(({ p }) => lcbayes.face(p)) : [];
        if (blocking.length) for (const one of polygons) one.face = lcbayes.face(one.p);
        const mobile = given && (m.attitude.mobile || []).map((f) => ({ facets: new Set(f.facets), axes: numbers(f.axes, Int16Array) }));
        made.set(key, polygons && { polygons, blocking, mobile, rotate: given ? null : toBody(m.attitude, row),
          sun: given && directions("sun"), obs: given && directions("obs") });
      }
      return made.get(key);
    }
    function between(values, index) {
      const i = Math.floor(index), f = index - i, j = Math.min(i + 1, data.t.length - 1);
      const a = [...values.subarray(3 * i, 3 * i + 3)];
      return unit(f && data.segmentOf[i] === data.segmentOf[j] ? a.map((x, k) => x + f * (values[3 * j + k] - x)) : a);
    }
    function paint() {
      const m = data.modes[now.mode], found = m && m.bodies && body(now.mode, now.row);
      if (!found) { canvas.getContext("2d").clearRect(0, 0, canvas.width, canvas.height); return; }
      const i = Math.floor(now.index), f = now.index - i, j = Math.min(i + 1, data.t.length - 1);
      const t = data.t[i] + (data.segmentOf[i] === data.segmentOf[j] ? f * (data.t[j] - data.t[i]) : 0);
      const rotate = found.rotate ? found.rotate(t) : (v) => v, known = m.attitude;
      const obs = known ? rotate(between(found.obs || data.obs, now.index)) : unit([1, 0.6, 0.5]);
      const sun = known ? rotate(between(found.sun || data.sun, now.index)) : null;
      const axis = m.axis && (m.attitude && m.attitude.kind === "rate" ? axisOf(m, now.row) : m.axis);
      let up = axis || rotate([0, 0, 1]);
      up = plus(up, obs, -dot(up, obs));
      if (Math.hypot(...up) < 1e-3) up = plus(cross(obs, [1, 0, 0.3]), obs, 0);
      up = unit(up);
      let towards = turned(obs, up, turn.yaw), right = cross(up, towards);
      towards = turned(towards, right, turn.pitch);
      const view = [right, cross(towards, right), towards];
      const spread = m.bodies.uncertainty, [low, high] = [Math.min(...spread), Math.max(...spread)];
      const plain = m.bodies.solids && !(m.bodies.names && m.bodies.names.length > 1);
      const colours = { plain: (k) => (plain ? STONE : hue(k)), uncertainty: (k) => lcbayes.rgb((spread[k] - low) / (high - low || 1)).map((c) => c / 255) }[by];
      const scene = { solid: Boolean(m.bodies.solids), parts: Boolean(m.bodies.names), axis, labels: [], flat: by !== "plain",
        polygons: found.polygons.map(({ p, facet, face }) => ({ p: moved(found, p, facet), c: colours(facet),
          dark: Boolean(sun && face && dot(face.n, obs) > 0 && lcbayes.inShadow(face, found.blocking, sun)) })) };
      lcbayes.paintBody(canvas, scene, view, sun && view.map((row) => dot(row, sun)));
      note.hidden = by === "plain";
      if (by !== "plain") note.textContent = `Relative standard deviation of the albedo-area of a ${m.bodies.names ? "material" : "facet"}: ${percent(low)} (blue) to ${percent(high)} (yellow).`;
      canvas.dataset.view = [...obs, turn.yaw, turn.pitch].map((v) => v.toFixed(3)).join(" ");
    }
    // a facet on an array or in other axes, in those of the body at the nearest point
    function moved(found, p, facet) {
      const frame = found.mobile && found.mobile.find((f) => f.facets.has(facet));
      if (!frame) return p;
      const r = frame.axes.subarray(9 * Math.round(now.index), 9 * Math.round(now.index) + 9);
      return p.map((v) => [0, 1, 2].map((i) => (r[3 * i] * v[0] + r[3 * i + 1] * v[1] + r[3 * i + 2] * v[2]) / 32000));
    }
    const percent = (x) => `${(100 * x).toPrecision(2)} %`;
    function axisOf(m, row) { return unit(atStart(m.attitude, row)(part(m.attitude.omega, row, 3))); }
    function rotateBy(dx, dy) { turn.yaw -= dx; turn.pitch = Math.max(-1.5, Math.min(1.5, turn.pitch + dy)); paint(); }

    let last = null;
    canvas.addEventListener("pointerdown", (e) => { last = [e.clientX, e.clientY]; try { canvas.setPointerCapture(e.pointerId); } catch (_) { /* gone */ } });
    canvas.addEventListener("pointermove", (e) => {
      if (!last) return;
      rotateBy((e.clientX - last[0]) / 120, (e.clientY - last[1]) / 120); last = [e.clientX, e.clientY];
    });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => { last = null; });
    canvas.addEventListener("dblclick", () => { turn.yaw = turn.pitch = 0; paint(); });
    canvas.addEventListener("keydown", (e) => {
      const step = { ArrowLeft: [-0.12, 0], ArrowRight: [0.12, 0], ArrowUp: [0, 0.12], ArrowDown: [0, -0.12] }[e.key];
      if (step) { e.preventDefault(); rotateBy(...step); }
    });
    new ResizeObserver(paint).observe(canvas);
    return {
      has: (mode) => Boolean(data.modes[mode].bodies), paint,
      pose: (mode, row, index) => { now = { mode, row, index }; paint(); },
      paintBy: (name) => { by = name; paint(); },
    };
  };
})(window.lcbayes);
